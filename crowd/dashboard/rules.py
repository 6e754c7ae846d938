"""Why a run or a session does not count: a sentence for each code that crowd.results gives as a reason."""

RULES: dict[str, str] = {
    "failed": "the run did not finish",
    "ate_missing": "the client told no trajectory error, so nothing shows that tracking held",
    "ate_above_limit": "the largest trajectory error reached the limit: fast and lost is not faster",
    "stages_exceed_frames": "its stages take longer together than the computation they are part of",
    "no_pair": "no repeat of the configuration has a repeat of the default to be compared with",
    "drift": "the second repeat of a configuration was much slower than the first: the device slowed down",
}
