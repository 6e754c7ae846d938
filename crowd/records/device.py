"""A device model as the public sees it."""

from typing import Annotated

from crowd.records.record import Record
from wire.meaning import means

HANDHELD = frozenset({"Android", "iOS", "iPadOS"})


class Device(Record, frozen=True, kw_only=True):
    """A device model as the public sees it: by its name, or by its chip where that is masked."""

    slug: Annotated[str, means("its name in addresses: /devices/NAME/", column="device")]
    manufacturer: Annotated[str, means("maker, empty where it is not known")]
    name: Annotated[str, means("common name of the model, with its code in brackets")]
    cpu: Annotated[str, means("processor, empty where it is not known")]
    soc: Annotated[str, means("system on a chip, empty where it is not known")]
    gpu: Annotated[str, means("graphics chip, empty where it is not known")]
    os: Annotated[str, means("Android, Linux, macOS, Windows")]
    simulated: Annotated[bool, means("true on a demo server, whose devices do not exist", column=None)] = (
        False
    )
    masked: Annotated[bool, means("whether it is named by its chip, because few people measured it")] = False
    kind: str = ""
    vendor: str = ""

    @property
    def title(self) -> str:
        """Maker and name."""
        return f"{self.manufacturer} {self.name}".strip()

    @property
    def handheld(self) -> bool:
        """Whether it is a phone or tablet: these measure in their browsers."""
        return self.os in HANDHELD
