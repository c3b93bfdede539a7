"""Evaluates feed-forward 3D Gaussian Splatting under the protocols of published benchmarks.

>>> import atsplat
>>> protocol = atsplat.protocol("re10k-2v-256")
>>> for trial in protocol.trials("data/re10k", limit=100):
...     images = my_method(trial.context.images, trial.context.cameras, trial.target.cameras)
...     print(trial.scene, trial.score(images).mean["psnr"])
>>> store = atsplat.evaluate(my_method, ["re10k-2v-256"], data="data/re10k", out="store")
>>> atsplat.report(store).table("re10k")

Images are float arrays of ... x height x width x 3 with display-referred RGB in [0, 1]. Camera axes are OpenCV's (+x right, +y
down, +z forward); distances are in units of the trial's normalised scene. Arrays may be NumPy's, PyTorch's, or of any library that
speaks DLPack or ``__array__``; results are NumPy's.
"""

from ._native import __version__
from .cameras import Cameras
from .drift import Drift, accept_baseline, drift
from .errors import AtsplatError, DriftedError, FileError, InvalidError, NotApplicable
from .evaluation import RayOptions, evaluate
from .gaussians import Gaussians
from .metrics import lpips, metrics, psnr, ssim
from .protocols import Data, Protocol, Scores, Skipped, Trial, Trials, Views, protocol, protocols
from .rendering import Rendering, render
from .reports import Report, Table, report
from .stores import Store, merge, open_store

__all__ = [
    "AtsplatError",
    "Cameras",
    "Data",
    "Drift",
    "DriftedError",
    "FileError",
    "Gaussians",
    "InvalidError",
    "NotApplicable",
    "Protocol",
    "RayOptions",
    "Rendering",
    "Report",
    "Scores",
    "Skipped",
    "Store",
    "Table",
    "Trial",
    "Trials",
    "Views",
    "__version__",
    "accept_baseline",
    "drift",
    "evaluate",
    "lpips",
    "merge",
    "metrics",
    "open_store",
    "protocol",
    "protocols",
    "psnr",
    "render",
    "report",
    "ssim",
]
