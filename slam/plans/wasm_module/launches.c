// Executes lists of launches, by one thread or several that share them. The host puts everything into memory: the
// launches, a list of their addresses for each call, `Team`, and for each thread a stack and a place for its work-item.

typedef unsigned int uint;

typedef struct {
    uint arrived;      // threads that have come to the end of the launch
    uint launches;     // that all threads have ended, ever
    uint calls;        // of `run`, ever
    uint list, count;  // of the call
    uint stopping;
} Team;

// Followed by the arguments in the kernel's order: 4 bytes for each plane of a buffer (its address) or number, 16 for
// a vector.
typedef struct {
    uint kernel, width, items; // of `items` work-items, `width` side by side in the first direction
    uint next;                 // the first that no thread has taken
    uint arguments[];
} Launch;

#define SPINS 2000  // looks at a word before a thread sleeps; some 10 microseconds
#define SHARES 8    // parts of a launch for each thread, so that they end together

void launch(uint kernel, const uint *arguments, uint width, uint from, uint to); // generated

// Returns once the word is not `value` any more.
static void await(uint *word, uint value)
{
    for (int spin = 0; spin < SPINS; ++spin)
        if (__atomic_load_n(word, __ATOMIC_SEQ_CST) != value)
            return;
    while (__atomic_load_n(word, __ATOMIC_SEQ_CST) == value)
        __builtin_wasm_memory_atomic_wait32((int *)word, value, -1);
}

static void change(uint *word, uint value)
{
    __atomic_store_n(word, value, __ATOMIC_SEQ_CST);
    __builtin_wasm_memory_atomic_notify((int *)word, -1);
}

// A thread's part of the launches of a call. All threads end one before any begins the next.
static void take_part(Team *team, uint threads)
{
    const uint *list = (const uint *)team->list;
    const uint count = team->count;
    for (uint number = 0; number < count; ++number) {
        Launch *next = (Launch *)list[number];
        const uint items = next->items;
        if (threads == 1) {
            launch(next->kernel, next->arguments, next->width, 0, items);
            continue;
        }
        const uint ended = __atomic_load_n(&team->launches, __ATOMIC_SEQ_CST);
        const uint share = (items + SHARES * threads - 1) / (SHARES * threads);
        uint from;
        while ((from = __atomic_fetch_add(&next->next, share, __ATOMIC_SEQ_CST)) < items)
            launch(next->kernel, next->arguments, next->width, from, from + share < items ? from + share : items);
        if (__atomic_add_fetch(&team->arrived, 1, __ATOMIC_SEQ_CST) < threads) {
            await(&team->launches, ended);
            continue;
        }
        next->next = 0;
        team->arrived = 0;
        change(&team->launches, ended + 1);
    }
}

// Executes `count` launches, whose addresses lie in `list`, together with `threads` - 1 threads in `serve`.
void run(Team *team, uint list, uint count, uint threads)
{
    if (count == 0)
        return;
    team->list = list;
    team->count = count;
    if (threads > 1)
        change(&team->calls, team->calls + 1);
    take_part(team, threads);
}

// Takes part in every call of `run`, from the first on, until `stop`.
void serve(Team *team, uint threads)
{
    for (uint calls = 0;; ++calls) {
        await(&team->calls, calls);
        if (team->stopping)
            return;
        take_part(team, threads);
    }
}

void stop(Team *team)
{
    team->stopping = 1;
    change(&team->calls, team->calls + 1);
}
