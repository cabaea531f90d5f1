"""What a written raster says of its making, in tags that GDAL and its kin show."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from skyscatter.dehaze.flags import MEANINGS


def tags(summary: Mapping[str, Any]) -> dict[str, str]:
    """Tags for every file of a run: version, haze and its error, aerosol, the mask's bits, and the whole summary."""
    import skyscatter

    aod, aerosol = summary.get("aod"), summary.get("aerosol")
    found = {"VERSION": skyscatter.__version__, "KIND": summary["kind"]}
    if aod is not None:
        found |= {"AOD_550": aod["mean"], "AOD_550_SIGMA": aod["sigma"], "AOD_SOURCE": aod["source"]}
    if aerosol is not None:
        found["AEROSOL"] = aerosol["model"]
    found["MASK_BITS"] = "; ".join(f"{int(flag)} = {words}" for flag, words in MEANINGS.items())
    found["SUMMARY"] = json.dumps(summary, allow_nan=False)
    return {f"SKYSCATTER_{name}": str(value) for name, value in found.items()}
