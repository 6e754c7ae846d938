"""iPhones and iPads. Their browsers do not report the model, so owners choose it."""

_IPHONES = {
    "11": ("", "Pro", "Pro Max"),
    "12": ("", "mini", "Pro", "Pro Max"),
    "13": ("", "mini", "Pro", "Pro Max"),
    "14": ("", "Plus", "Pro", "Pro Max"),
    "15": ("", "Plus", "Pro", "Pro Max"),
    "16": ("", "Plus", "Pro", "Pro Max"),
    "16e": ("",),
    "17": ("", "Pro", "Pro Max"),
    "Air": ("",),
    "SE (2020)": ("",),
    "SE (2022)": ("",),
}
_IPADS = (
    "(2019)", "(2020)", "(2021)", "(2022)", "(2025)", "Air (2019)", "Air (2020)", "Air (2022)",
    "Air 11 (2024)", "Air 13 (2024)", "Air 11 (2025)", "Air 13 (2025)", "mini (2019)", "mini (2021)",
    "mini (2024)", "Pro 11 (2018)", "Pro 11 (2020)", "Pro 11 (2021)", "Pro 11 (2022)", "Pro 11 (2024)",
    "Pro 11 (2025)", "Pro 12.9 (2018)", "Pro 12.9 (2020)", "Pro 12.9 (2021)", "Pro 12.9 (2022)",
    "Pro 13 (2024)", "Pro 13 (2025)",
)  # fmt: skip
MODELS = (
    *(f"iPhone {number} {size}".rstrip() for number, sizes in _IPHONES.items() for size in sizes),
    *(f"iPad {name}" for name in _IPADS),
)
