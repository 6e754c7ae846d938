"""Fields that several records share."""

from typing import Annotated

from wire.meaning import means

Application = Annotated[str, means("such as kfusion")]
Front = Annotated[str, means("version of the front: with configuration, a row of configurations")]
Configuration = Annotated[str, means("name of the configuration in that front")]
Baseline = Annotated[str, means("the configuration that it is compared with")]
Backend = Annotated[str, means("what computed, such as opencl")]
Processor = Annotated[str, means("the chip that computed, as the rules call it")]
ProcessorClass = Annotated[str, means("cpu or gpu")]
State = Annotated[
    str,
    means(
        "valid, suspect, invalid, quarantined, or pending (not checked yet): valid ones make figures, "
        "suspect ones where none is valid"
    ),
]
Reason = Annotated[str, means("code of the rule that set the state; empty for a valid or pending one")]
Algorithm = Annotated[int, means("version of the statistics that computed it", json=None, arrow="int32")]
