"""Well-known names of chips: systems on a chip, processors, graphics chips.

Drivers, kernels and catalogues spell one chip in many ways ("QTI SM8550", "kalama"; "Qualcomm Adreno (TM)
506", "QUALCOMM Adreno(TM) 506"). Rules map them to one name. Other text never becomes part of a name:
names are public, and anyone can send any text.
"""

from crowd.devices.chips.central_processors import processor
from crowd.devices.chips.graphics_chips import Graphics, graphics
from crowd.devices.chips.systems_on_chip import system_on_chip
from crowd.devices.chips.web_adapters import Adapter, adapter, is_one_chip

__all__ = ["Adapter", "Graphics", "adapter", "graphics", "is_one_chip", "processor", "system_on_chip"]
