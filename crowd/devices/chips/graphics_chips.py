"""Rules for the names that drivers and catalogues give to graphics chips."""

import re
from dataclasses import dataclass

from crowd.devices.chips.rules import compile_rules, first_match

# Software renderers and placeholders of drivers: not graphics chips.
NO_GRAPHICS = re.compile(
    r"swiftshader|llvmpipe|softpipe|pixelflinger|emulator|virtualbox|vmware|svga3d|virgl|aspeed|matrox|"
    r"^(cpu|pthread|basic|default|unknown|chromium)\b|^pocl|\bcpu\b|\bxeon e\d|\bcore processor|"
    r"\bw(ith|/) (amd )?radeon",
    re.IGNORECASE,
)
NOISE = re.compile(
    r"\((?:r|tm|c|rev \w+|\d+ mhz)\)|[®™]|_|^\d+x |\[0x[0-9a-f]+\]|\bcorporation\b|"
    r"\bimagination tech(?:nologies)?\b",
    re.IGNORECASE,
)
# What follows the number of a GeForce.
SUFFIX = r"(?: ?(ti))?(?: (super))?(?: (d))?(?: (\d{1,2}gb))?(?: (?:with )?(laptop gpu|mobile|max-q))?(?!\w)"
MALI = (
    (r"\bimmortalis[ -]?g(\d{3,4})\b", "Immortalis-G{0}"),
    (r"\bmali[ -]?g1[ -](ultra|premium|pro)\b", "Mali-G1-{0}"),
    (r"\bmali[ -]?([gt]?\d{2,4}(?:ae)?)(?:mp\d{0,2})?\b", "Mali-{0}"),
    (r"\bmali\b", "Mali"),
)
ADRENO = (
    (r"\badreno[ -]?(x\d-\d{2})\b", "Adreno {0}"),
    (r"(?:\badreno[ -]?|^fd)(\d{3}[a-z]?)\b", "Adreno {0}"),
    (r"\badreno\b", "Adreno"),
)
POWERVR = (
    (r"\b(b?[bcd]x[emst])[ -](\d{1,2})-(\d{2,4})\b", "PowerVR {0}-{1}-{2}"),
    (r"\bpowervr (?:rogue )?sgx ?(\d{3})(?: ?mp\d?)?\b", "PowerVR SGX{0}"),
    (r"\bpowervr (?:rogue )?(g[emtx]?\d{4})(?: (plus))?\b", "PowerVR {0} {1}"),
    (r"\bpowervr\b", "PowerVR"),
)
XCLIPSE = (
    (r"\bxclipse ?(\d{3}[a-z]?)\b", "Samsung Xclipse {0}"),
    (r"\bxclipse\b", "Samsung Xclipse"),
)
APPLE = (
    (r"\bapple ([am]\d{1,2}[xz]?)(?: (bionic|fusion|pro|max|ultra))?\b", "Apple {0} {1}"),
    (r"^apple(?: gpu)?$", "Apple GPU"),
)
NVIDIA = (
    (r"\bgeforce (?:gtx )?titan(?: ([xz]|black))?(?!\w)", "NVIDIA GeForce GTX TITAN {0}"),
    (r"(?:^|\bnvidia )titan(?: (xp|rtx|[vxz]))?(?!\w)", "NVIDIA TITAN {0}"),
    (r"\bgeforce (mx\d{3})\b", "NVIDIA GeForce {0}"),
    (
        rf"\bgeforce (?:([rg]tx|gts?|g) ?)?(\d{{3,4}}[adm]?x?){SUFFIX}",
        "NVIDIA GeForce {0} {1} {2} {3} {4} {5} {6}",
    ),
    (rf"\b(gtx) ?(\d{{3,4}}m?){SUFFIX}", "NVIDIA GeForce {0} {1} {2} {3} {4} {5} {6}"),
    (rf"\b(rtx) ?([2-9]0[5-9]0){SUFFIX}", "NVIDIA GeForce {0} {1} {2} {3} {4} {5} {6}"),
    (r"^(\d{3}mx?) nvidia$", "NVIDIA GeForce {0}"),
    (
        r"\bquadro (?:(rtx|nvs|fx) ?)?((?:g[pv]|[kmpt])?\d{3,4}[dm]?)(?: (?:with )?(max-q))?\b",
        "NVIDIA Quadro {0} {1} {2}",
    ),
    (
        r"\btesla ([ckmptv]\d{1,4}(?:xm|[cmsx])?)(?:[ -](sxm\d?|pcie))?(?:[ -](\d{2}gb))?\b",
        "NVIDIA Tesla {0} {1} {2}",
    ),
    (
        r"\brtx pro (\d{4})(?: (blackwell))?"
        r"(?: (max-q workstation edition|workstation edition|server edition|generation))?"
        r"(?: (laptop gpu))?\b",
        "NVIDIA RTX PRO {0} {1} {2} {3}",
    ),
    (r"\brtx (a\d{3,4})(?: (\d{1,2}gb))?(?: (laptop gpu))?\b", "NVIDIA RTX {0} {1} {2}"),
    (
        r"\brtx (\d{3,4})(?: (sff))?(?: (ada)(?: generation)?)?(?: (laptop gpu))?\b",
        "NVIDIA RTX {0} {1} {2} {3}",
    ),
    (
        r"\bnvidia (g[bh]\d{2,3}|[abhl]\d{1,3}[gs]?|t\d{1,4})(?:[ -](sxm\d?|pcie|nvl))?(?:[ -](\d{2,3}gb))?"
        r"(?: (hbm\de?|pcie))?(?: (laptop gpu))?(?: (mig \dg\.\d{1,3}gb))?\b",
        "NVIDIA {0} {1} {2} {3} {4} {5}",
    ),
    (r"\bnvs ?(\d{3,4}m?)\b", "NVIDIA NVS {0}"),
    (r"\btegra ?t?(k1|x[12]|[234])(?!\w)", "NVIDIA Tegra {0}"),
    (r"\btegra\b", "NVIDIA Tegra"),
    (r"^(?:nvidia )?(orin|xavier|thor)\b", "NVIDIA {0}"),
    (r"\bnvidia (kepler|maxwell|pascal|volta|turing|ampere|ada|lovelace|hopper|blackwell)\b", "NVIDIA {0}"),
    (r"\bgeforce\b", "NVIDIA GeForce"),
    (r"\bnvidia\b", "NVIDIA GPU"),
)
RADEON = (
    (r"\binstinct mi ?(\d{2,3}[ax]?)\b", "AMD Instinct MI{0}"),
    (r"\bfirepro ([dsvw]\d{3,4}m?)\b", "AMD FirePro {0}"),
    (r"\bradeon (?:(rx) )?vega ?(\d{1,2})\b", "AMD Radeon {0} Vega {1}"),
    (r"\bradeon vii\b", "AMD Radeon VII"),
    (r"\bradeon rx ?(\d{3,4}[ms]?)(?: ?(xtx|xt|gre|le))?(?: (\d{1,2}gb))?\b", "AMD Radeon RX {0} {1} {2}"),
    (r"\bradeon pro (?:(vega|wx|ssg|duo) ?)?([wv]?\d{2,4}x?m?)\b", "AMD Radeon Pro {0} {1}"),
    (r"\bradeon hd ?(\d{4}[dgm]?)\b", "AMD Radeon HD {0}"),
    (r"\bradeon r([579]) (m?\d{3}[emx]?)\b", "AMD Radeon R{0} {1}"),
    (r"\bradeon r([579]) (fury x|fury|nano)\b", "AMD Radeon R{0} {1}"),
    (r"\bradeon r([2-9])\b", "AMD Radeon R{0}"),
    (r"\bradeon (\d{3,4}[ms])\b", "AMD Radeon {0}"),
    (
        r"\bradeonsi, (renoir|raphael|cezanne|lucienne|barcelo|rembrandt|phoenix|mendocino|vangogh|picasso|"
        r"raven)\b",
        "AMD Radeon Graphics {0}",
    ),
    (r"\bgfx([6-9]\d[\da-f]|1[0-2]\d[\da-f])\b", "AMD gfx{0}"),
    (r"^(?:amd )?(ellesmere|baffin|tahiti|pitcairn|bonaire|oland|hawaii|fiji|tonga|lexa)$", "AMD {0}"),
    (r"\bamd ([cr]dna|gcn)[ -](\d)\b", "AMD {0} {1}"),
    (r"\bradeon\b", "AMD Radeon Graphics"),
)
INTEL = (
    (r"\barc (?:(pro) )?([ab]\d{2,3}m?|1\d0[tv])\b", "Intel Arc {0} {1}"),
    (r"\bintel arc\b", "Intel Arc Graphics"),
    (r"\bdata center gpu (max|flex) (\d{3,4})\b", "Intel Data Center GPU {0} {1}"),
    (r"\biris (?:(plus|pro) )?(?:graphics )?(p?\d{3,4})\b", "Intel Iris {0} Graphics {1}"),
    (r"\biris(?: (xe|plus|pro))?(?: graphics)?(?: (max))?\b", "Intel Iris {0} {1} Graphics"),
    (r"\b(u?hd)(?: graphics)? (p?\d{3,4})\b", "Intel {0} Graphics {1}"),
    (r"\b(u?hd)(?: graphics)? (\d\d)gen\b", "Intel {0} Graphics {1}gen"),
    (r"\bintel(?: \w+)? (u?hd) graphics\b", "Intel {0} Graphics"),
    (r"\bintel graphics (\d\d)gen\b", "Intel Graphics {0}gen"),
    (r"\bintel\b.* graphics\b", "Intel Graphics"),
)
OTHERS = (
    ("Vivante", r"\bgc ?nano ?(ultra|lite)\b", "Vivante GC Nano {0}"),
    ("Vivante", r"\bgc ?(\d{3,4}(?:ul|xs|l)?)\b", "Vivante GC{0}"),
    ("VideoCore", r"\b(?:v3d|videocore) (vc\d|vii?|iv|\d(?:\.\d{1,2}){1,3})\b", "Broadcom VideoCore {0}"),
    ("VideoCore", r"\b(?:v3d|videocore)\b", "Broadcom VideoCore"),
    ("Maleoon", r"\bmaleoon ?(\d{3})\b", "HiSilicon Maleoon {0}"),
    ("Moore Threads", r"\bmtt ([sx]\d{2,4})\b", "Moore Threads MTT {0}"),
)
FAMILIES = (
    ("Mali", compile_rules(MALI)),
    ("Adreno", compile_rules(ADRENO)),
    ("PowerVR", compile_rules(POWERVR)),
    ("Xclipse", compile_rules(XCLIPSE)),
    ("Apple", compile_rules(APPLE)),
    ("NVIDIA", compile_rules(NVIDIA)),
    ("Radeon", compile_rules(RADEON)),
    ("Intel", compile_rules(INTEL)),
    *((family, compile_rules([(pattern, name)])) for family, pattern, name in OTHERS),
)


@dataclass(frozen=True)
class Graphics:
    """A graphics chip: its driver family and its name.

    If only the family is known, the name is that of the family: "Adreno", "NVIDIA GPU".
    """

    family: str
    name: str


def graphics(line: str) -> Graphics | None:
    """The graphics chip that `line` of a driver or a catalogue names.

    None if no rule matches, and for software renderers.
    """
    clean = re.sub(r"(\d) gb\b", r"\1GB", " ".join(NOISE.sub(" ", line).split()), flags=re.IGNORECASE)
    if NO_GRAPHICS.search(clean):
        return None
    for family, rules in FAMILIES:
        if name := first_match(rules, clean):
            return Graphics(family, name)
    return None
