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

import importlib.util as _importlib
import pathlib as _pathlib
import sys as _sys

if _importlib.find_spec("._hord", __name__) is None:  # the module is compiled for one version of Python
    raise ImportError(
        f"hord cannot be used by this Python ({_sys.executable}, {_sys.version_info.major}.{_sys.version_info.minor}): "
        f"it holds {', '.join(f.name for f in _pathlib.Path(__file__).parent.glob('_hord.*')) or 'no compiled module'}: "
        "call the Python that it was built for (Debian's /usr/bin/python3), or build it again: ./dev build")

if _importlib.find_spec("numpy") is None:
    raise ImportError(f"hord needs NumPy, and this Python ({_sys.executable}) has none: install Debian's python3-numpy")

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
from .plain import make_plain as _make_plain
from .errors import Error, InvalidArgument, IoError, NotFound, Refused, Unreadable, Unsupported

_make_plain(globals())

__all__ = [
    "AT_LIMIT", "BORDER", "DARK", "FEATURES", "OUTSIDE", "RIM", "SATURATED",
    "Calibration", "Comparison", "Hords", "Inspection", "Inspector", "Learned", "LightField", "Map", "Recipe",
    "Reference", "__version__", "calibrate", "compare", "decode", "distance", "from_samples", "inspect", "learn",
    "read", "Error", "InvalidArgument", "IoError", "NotFound", "Refused", "Unreadable", "Unsupported",
]
