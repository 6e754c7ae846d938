// Whether a launch has something to do: WHILE_ITERATING while the level needs another iteration, WHILE_RETRYING in a frame's
// second attempt.
fn is_wanted() -> bool {
    return ((parameters.conditional & WHILE_ITERATING) == 0 || state.iterating != 0)
        && ((parameters.conditional & WHILE_RETRYING) == 0 || state.retrying != 0);
}
