"""Rules for the names that kernels and OpenCL give to processors."""

import re

from crowd.devices.chips.rules import compile_rules, first_match

NOISE = re.compile(
    r"\((?:r|tm|c)\)|[®™]|\b(?:cpu|processor)\b|@.*$|\b\d+(?:\.\d+)?\s*[mg]hz\b|"
    r"\b(?:\d+|dual|triple|quad|six|eight|ten|twelve|sixteen)[- ]core\b|\bw(?:ith\b|/).*$",
    re.IGNORECASE,
)
AMD = (
    (r"\bepyc (?:embedded )?([3-9][\dbcdfhjkrtv][\df]\d(?:[fpsx]|pn)?)\b", "AMD EPYC {0}"),
    (r"\bepyc-(naples|rome|milan|genoa|turin)\b", "AMD EPYC {0}"),
    (r"\bepyc\b", "AMD EPYC"),
    (r"\bthreadripper (?:(pro) )?(\d{4}(?:wx|x)?)\b", "AMD Ryzen Threadripper {0} {1}"),
    (r"\bthreadripper\b", "AMD Ryzen Threadripper"),
    (
        r"\bryzen ai (max\+?|[3579])(?: (hx))?(?: (pro))?(?: (hx))? (\d{3})\b",
        "AMD Ryzen AI {0} {1} {3} {2} {4}",
    ),
    (
        r"\bryzen ([3579])(?: (pro))? (\d{3,4}(?:h?x3d|xt|h[sx]|g[et]|a?f|[ceghsux])?)\b",
        "AMD Ryzen {0} {1} {2}",
    ),
    (r"\bryzen (z\d)(?: (extreme|go))?\b", "AMD Ryzen {0} {1}"),
    (r"\bryzen embedded ([rv]\d{4}[a-z]?)\b", "AMD Ryzen Embedded {0}"),
    (r"\bryzen ([3579])\b", "AMD Ryzen {0}"),
    (r"\bryzen\b", "AMD Ryzen"),
    (
        r"\bathlon(?: (64|ii|silver|gold|pro))?(?: (x[234]))?(?: (\d{3,4}(?:\+|ge|[begku])?))?(?!\w)",
        "AMD Athlon {0} {1} {2}",
    ),
    (r"\bphenom(?: (ii))?(?: (x[2346]))?(?: (\d{4}[bet]?))?(?!\w)", "AMD Phenom {0} {1} {2}"),
    (r"\bamd fx ?-?(\d{4}[ep]?)\b", "AMD FX-{0}"),
    (r"\bamd (a(?:4|6|8|9|10|12)) ?-?(?:(pro)-)?(\d{4}[a-z]?)\b", "AMD {1} {0}-{2}"),
    (r"\bamd (e[12]?)-(\d{3,4})\b", "AMD {0}-{1}"),
    (r"\bopteron(?: (x\d))?(?: (\d{3,4}))?(?: ([ehs]e))?(?!\w)", "AMD Opteron {0} {1} {2}"),
    (
        r"\bturion(?: (64|ii|x2))?(?: (x2|ultra))?(?: mobile)?(?: ([klmnprt]{1,2}-?\d{2,3}))?(?!\w)",
        "AMD Turion {0} {1} {2}",
    ),
    (r"\bsempron(?: (x2))?(?: (\d{3,4}\+?))?(?!\w)", "AMD Sempron {0} {1}"),
    (r"\bamd custom apu (\d{4})\b", "AMD Custom APU {0}"),
    (r"\bhygon c86 (\d{4})\b", "Hygon C86 {0}"),
)
INTEL = (
    (r"\b(?:core|intel) ultra (x?[3579]) (\d{3}(?:h[klx]|kf|[fhkputv])?)\b", "Intel Core Ultra {0} {1}"),
    (r"\bcore i3-n(\d{3})\b", "Intel Core i3-N{0}"),
    (r"\bi([357])-(\dy\d\d)\b", "Intel Core i{0}-{1}"),
    (r"\b(?:core|intel) m([357])-(\dy\d\d|\d{4}y)\b", "Intel Core m{0}-{1}"),
    (r"\bcore m-(\dy\d\d[ac]?)\b", "Intel Core M-{0}"),
    (r"\bcore i([3579])[ -]([lmqux]) ?(\d{3})\b", "Intel Core i{0} {1} {2}"),
    (
        r"\b(?:core|intel) i([3579])[ -](\d{3,5}(?:g[1-7]e?|gre|h[efklqx]|kf|ks|[lpqrtu]e|[elq]m|[mx]m|"
        r"[em]q|mx|tf|[a-z])?)\b",
        "Intel Core i{0}-{1}",
    ),
    (r"\b(?:core|intel) i([3579])\b", "Intel Core i{0}"),
    (r"\bcore ([3579]) (n?\d{3}(?:hl|[efhu])?)\b", "Intel Core {0} {1}"),
    (
        r"\bcore ?2(?: (duo|quad|extreme|solo))?(?: ((?:s[lpu]|qx|[elpqtux])?\d{4}[bmps]?))?(?!\w)",
        "Intel Core 2 {0} {1}",
    ),
    (r"\bxeon (platinum|gold|silver|bronze|max) (\d{4}(?:cl|ne|[a-z]|\+)?)(?!\w)", "Intel Xeon {0} {1}"),
    (r"\bxeon (e[357])-? ?(\d{4}[lmw]?)(?: 0)?(?: (v[2-6]))?\b", "Intel Xeon {0}-{1} {2}"),
    (r"\bxeon w([3579])-(\d{4}[a-z]?)\b", "Intel Xeon w{0}-{1}"),
    (r"\bxeon ([dew])-(\d{4,5}(?:nt|it|te|[a-z])?)\b", "Intel Xeon {0}-{1}"),
    (r"\bxeon (?:6 )?(\d{4}[ep])\b", "Intel Xeon 6 {0}"),
    (r"\bxeon ([elwx]?\d{4})\b", "Intel Xeon {0}"),
    (r"\bxeon phi(?: (\d{4}[fp]?))?(?!\w)", "Intel Xeon Phi {0}"),
    (r"\bxeon\b", "Intel Xeon"),
    (r"\bceleron(?: dual)?(?: (m))?(?: ([bgjnptu]?\d{3,4}(?:te|[elmtuy])?))?(?!\w)", "Intel Celeron {0} {1}"),
    (
        r"\bpentium(?: (gold|silver|dual|pro|iii|ii|4|d|m))?(?: ([egjnpstu]?\d{3,4}[aejlmtuy]?))?(?!\w)",
        "Intel Pentium {0} {1}",
    ),
    (r"\b(?:atom|intel) x([3567])-z?(\d{4})\b", "Intel Atom x{0}-Z{1}"),
    (r"\b(?:atom|intel) x([3567])-([ce]\d{4})\b", "Intel Atom x{0}-{1}"),
    (r"\batom ([cdenpxz]?\d{3,4}[a-z]{0,2})\b", "Intel Atom {0}"),
    (r"\bintel (?:byz?t )?(z\d{4}[a-z]?)\b", "Intel Atom {0}"),
    (r"\batom\b", "Intel Atom"),
    (r"\bintel (n2\d{3}|n3[0-6]\d\d|n4[015]\d\d)\b", "Intel Celeron {0}"),
    (r"\bintel (n\d{2,4}|u\d{3})\b", "Intel {0}"),
    (r"\bitanium(?: (2))?(?!\w)", "Intel Itanium {0}"),
    (r"\bintel core\b", "Intel Core"),
)
OTHERS = (
    (r"\bapple (m\d{1,2})(?: (pro|max|ultra))?\b", "Apple {0} {1}"),
    (r"\bapple (a\d{1,2}[xz]?)(?: (bionic|fusion))?\b", "Apple {0} {1}"),
    (r"\bampere altra(?: (max))?(?: ([mq]\d{2,3}-\d{2}))?(?!\w)", "Ampere Altra {0} {1}"),
    (r"\bampereone\b", "AmpereOne"),
    (r"\bgraviton ?(\de?)\b", "AWS Graviton{0}"),
    (
        r"\bsnapdragon (x2?)(?: (elite|plus))?(?: (extreme))?(?: ?- ?(x\d[ep]?\d{5,6}))?(?!\w)",
        "Qualcomm Snapdragon {0} {1} {2} {3}",
    ),
    (r"\bsnapdragon ([78])(cx|c)(?: (gen \d))?\b", "Qualcomm Snapdragon {0}{1} {2}"),
    (r"\bmicrosoft sq([123])\b", "Microsoft SQ{0}"),
    (r"\bbcm(27\d\d|283[5-7])\b", "Broadcom BCM{0}"),
    (r"\bcortex[ -]([amrx]\d{1,3}(?:ae|c)?)\b", "Arm Cortex-{0}"),
    (r"\bneoverse[ -]([env]\d)\b", "Arm Neoverse {0}"),
    (r"\bkunpeng[ -](\d{3})\b", "HiSilicon Kunpeng {0}"),
    (r"\bphytium,? ?(ft-\d{4}|[ds]\d{4})\b", "Phytium {0}"),
    (r"\bthunderx(2)?\b", "Marvell ThunderX{0}"),
    (r"\ba64fx\b", "Fujitsu A64FX"),
    (r"\bloongson[ -](3[a-d]\d{4})\b", "Loongson {0}"),
    (r"\bpower(8|9|1[01])\b", "IBM POWER{0}"),
    (r"\bsifive[, -]+([psu]\d{2,3})\b", "SiFive {0}"),
)
RULES = compile_rules((*AMD, *INTEL, *OTHERS))


def processor(line: str) -> str:
    """The maker and model of the processor that `line` names; empty if no rule matches.

    `line` may also be the name of an OpenCL device on a processor: "cpu-znver4-AMD EPYC 9654".
    """
    return first_match(RULES, without_noise(line))


def without_noise(line: str) -> str:
    """`line` without trade marks, clock rates and core counts: the same for all devices with one
    processor."""
    return " ".join(NOISE.sub(" ", line).split())
