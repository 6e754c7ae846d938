"""What the parameters of the applications mean, with their units, as pages say it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Meaning:
    """What a parameter says, and its unit ("" for none)."""

    text: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.text} ({self.unit})" if self.unit else self.text


# The parameters of the spaces that searches use, by application.
MEANINGS = {
    "kfusion": {
        "volume_resolution": Meaning("length of each side of the volume", "voxels"),
        "compute_size_ratio": Meaning("every n-th pixel of the depth image is used, across and down"),
        "pyramid_iterations_fine": Meaning("most ICP iterations at full size"),
        "pyramid_iterations_middle": Meaning("most ICP iterations at half size"),
        "pyramid_iterations_coarse": Meaning("most ICP iterations at quarter size"),
        "integration_rate": Meaning("every n-th frame is fused into the volume"),
        "tracking_rate": Meaning("every n-th frame is tracked"),
        "mu": Meaning("truncation distance of the signed distance field", "m"),
        "icp_threshold": Meaning("iterations end when the update of the pose is smaller", "m and rad"),
    },
    "elasticfusion": {
        "icp_weight": Meaning("weight of depth beside brightness in tracking; 0: brightness alone"),
        "depth_cutoff": Meaning("depth beyond it is not used", "m"),
        "confidence_threshold": Meaning("a surfel of this confidence is stable"),
        "disable_so3": Meaning("no alignment by rotation before the registration"),
        "open_loop": Meaning("no loops are closed, and the whole map is active"),
        "relocalisation": Meaning("a lost camera is noticed and found again"),
        "fast_odometry": Meaning("brightness is registered at the finest level alone"),
        "frame_to_frame_rgb": Meaning("brightness is compared with the last frame instead of the model"),
    },
}


def meaning_of(name: str) -> str:
    """What the parameter NAME means, with its unit; "" where it is not one of MEANINGS."""
    found = (parameters[name] for parameters in MEANINGS.values() if name in parameters)
    return str(next(found, ""))
