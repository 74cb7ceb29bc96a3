"""The light field of a transparent part, and what the HORD station computes from it.

    import hord
    field = hord.read("part.png")            # N x M lenslets of J x I bins
    field.samples                            # NumPy [n, m, j, i], no copy
    field.feature("emd").filled              # a map: EMD between neighbours, bin pitches
    hord.inspect(field).verdict              # "pass", "reject" or "unfit", as hordctl inspect says

(m, n) counts lenslets, (i, j) the bins of a lenslet, both to the right and downwards; arrays have [n, m] and
[n, m, j, i]. Deflections and distances are in bin pitches, samples and light in DN. Errors are subclasses of
hord.Error with the sentences of hordctl: what failed, and what to do about it.
"""

from ._hord import (
    AT_LIMIT,
    BORDER,
    DARK,
    FEATURES,
    OUTSIDE,
    RIM,
    SATURATED,
    Calibration,
    Comparison,
    Hords,
    Inspection,
    Inspector,
    Learned,
    LightField,
    Map,
    Recipe,
    Reference,
    __version__,
    calibrate,
    compare,
    decode,
    distance,
    from_samples,
    inspect,
    learn,
    read,
)
from .errors import Error, InvalidArgument, IoError, NotFound, Refused, Unreadable, Unsupported

__all__ = [
    "AT_LIMIT", "BORDER", "DARK", "FEATURES", "OUTSIDE", "RIM", "SATURATED",
    "Calibration", "Comparison", "Hords", "Inspection", "Inspector", "Learned", "LightField", "Map", "Recipe",
    "Reference", "__version__", "calibrate", "compare", "decode", "distance", "from_samples", "inspect", "learn",
    "read", "Error", "InvalidArgument", "IoError", "NotFound", "Refused", "Unreadable", "Unsupported",
]
