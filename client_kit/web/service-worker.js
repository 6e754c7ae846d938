/** Opens /measure/ without a network: files of the last visit are cached, and used when the network fails. */

const CACHE = "frontrunner-measure";
const KEPT = ["/measure/", "/static/"];

/** @type {ServiceWorkerGlobalScope} */
const scope = /** @type {any} */ (self);

scope.addEventListener("install", () => void scope.skipWaiting());
scope.addEventListener("activate", (event) => event.waitUntil(scope.clients.claim()));

// The first visit loads before this worker controls the page: the page sends the list of its files.
scope.addEventListener("message", (event) => {
  if (event.data.type === "keep") event.waitUntil(keep(event.data.urls));
});

scope.addEventListener("fetch", (event) => {
  if (event.request.method === "GET" && isKept(event.request.url)) event.respondWith(answer(event.request));
});

/**
 * @param {string} url
 * @returns {boolean}
 */
function isKept(url) {
  const { origin, pathname } = new URL(url);
  return origin === scope.location.origin && KEPT.some((start) => pathname.startsWith(start));
}

/** @param {string[]} urls */
async function keep(urls) {
  const cache = await caches.open(CACHE);
  await Promise.all([...new Set(urls)].filter(isKept).map((url) => cache.add(url).catch(() => {})));
}

/**
 * The network's answer, which is cached; without a network the cached one.
 * @param {Request} request
 * @returns {Promise<Response>}
 */
async function answer(request) {
  const cache = await caches.open(CACHE);
  try {
    const response = await fetch(request);
    if (response.ok) await cache.put(request, response.clone());
    return response;
  } catch (error) {
    // A copy in the language of the address, else in the one that was read last; the headers do not say it.
    const options = { ignoreVary: true };
    const kept = (await cache.match(request, options)) ?? (await cache.match(request, { ...options, ignoreSearch: true }));
    if (kept) return kept;
    throw error;
  }
}
