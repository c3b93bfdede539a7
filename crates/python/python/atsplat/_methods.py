"""Methods as the native part calls them."""

from __future__ import annotations

import functools
import inspect
import json
import os
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arguments import title_of
from ._arrays import images, invalid
from ._contents import attribute
from ._identity import examined, rules
from ._members import called, inner
from .cameras import Cameras
from .errors import AtsplatError, NotApplicable
from .gaussians import Gaussians

#: Methods without learning that are part of atsplat.
BUILT_IN = {"nearest-view": "nearest view", "warp": "plane warp"}
#: The parameter of :class:`atsplat.torch.Evaluation`.
STATE = "state-sha256"
#: Parameters that have arguments of their own.
RESERVED = ("setting", "version", "identity", "background", "effects", "tolerance", "renderer", "mode")


def name_of(method: Callable[..., Any]) -> str:
    """The name of a function, or of an object's class, also of one of its methods; that of what wrappers wrap."""
    of = called(method)
    name = attribute(of, "__name__") or type(of).__name__
    return "method" if name == "<lambda>" else name


def record(
    method: Callable[..., Any] | str,
    name: str | None,
    title: str | None,
    parameters: Mapping[str, Any],
    setting: str,
    deterministic: bool,
    version: str | int | None = None,
) -> str:
    """What a store says about the method."""
    if not isinstance(parameters, Mapping):
        raise invalid("parameters", f"expected a dict, found {type(parameters).__name__}")
    if version is not None and (isinstance(version, bool) or not isinstance(version, (str, int))):
        raise invalid("version", f"expected a text or an integer, found {type(version).__name__}")
    if isinstance(method, str):
        if method not in BUILT_IN:
            raise invalid("method", f"expected a callable, or one of {', '.join(BUILT_IN)}, found {method!r}")
        other = None if setting.lower() == "atsplat" else setting
        stated = (("name", name), ("title", title), ("parameters", dict(parameters) or None), ("setting", other), ("version", version))
        for field, given in stated:
            if given is not None:
                raise invalid(field, f"expected none for {method}, which has its own, found {given!r}")
        name, kind, title = method, method, BUILT_IN[method]
    elif callable(method):
        name, kind = name or name_of(method), "python"
    else:
        raise invalid("method", f"expected a callable, found {type(method).__name__}")
    if name in ("truth", "context") or not all(c.isalnum() or c in "-_.+ " for c in name) or not name.strip():
        raise invalid("name", f"expected letters, digits, spaces, - _ . and +, other than truth and context, found {name!r}")
    title = title_of(title)
    recorded = {name: _stated(name, value) for name, value in parameters.items()}
    if not isinstance(method, str):
        known_by: dict[str, Any] = {"identity": _identity(method, recorded)} if version is None else {"version": version}
        recorded |= {"setting": setting, **known_by}
    return json.dumps({
        "name": name,
        "kind": kind,
        "title": title or name,
        "parameters": recorded,
        "weights-sha256": None,
        "untrained": False,
        "constants": None,
        "backend": None,
        "deterministic": deterministic or kind != "python",
    })


def _stated(name: str, value: Any) -> Any:
    if name in RESERVED:
        raise invalid("parameters", f"expected no {name!r}, which evaluate itself records")
    if isinstance(value, np.generic):
        value = value.item()
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise invalid("parameters", f"{name}: expected a value of JSON, found {type(value).__name__}: {error}") from None
    return value


def _identity(method: Callable[..., Any], stated: Mapping[str, Any]) -> dict[str, str]:
    try:
        parts, unseen = examined(method)
    except Exception as error:
        problem = f"its code and values cannot be distinguished from another method's ({type(error).__name__}: {error}): give version=…"
        raise invalid("method", problem) from error
    # A user who states parameters has thought of it; `Evaluation` states this one itself.
    if unseen and not set(stated) - {STATE}:
        listed = f"{', '.join(unseen[:5])}{', …' if len(unseen) > 5 else ''}"
        text = f"{name_of(method)}: the method's identity lacks what is in {listed}: give parameters=… or version=…"
        # Of the code that calls `evaluate`, which calls `record`.
        warnings.warn(text, stacklevel=4)
    # First of all, so that a list of differences begins with it.
    return {"(rules)": str(rules(parts)), **parts}


@dataclass(frozen=True)
class Info:
    """What else a method may know about a trial."""

    #: Key of the scene.
    scene: str
    #: Position of the index entry among the scene's.
    entry: int
    #: Near and far plane, in units of the trial's world.
    near_far: tuple[float, float]
    #: Overlap of the context views, if the index has it.
    overlap: float | None


def adapted(method: Callable[..., Any]) -> Callable[..., Any]:
    """Calls a method with arrays, and makes its output plain."""
    takes_trial = _takes_trial(method)

    def call(trial: Any) -> Any:
        context, target = Cameras._of(*trial.context_cameras()), Cameras._of(*trial.target_cameras())
        info = {"trial": Info(trial.scene, trial.entry, trial.near_far, trial.overlap)} if takes_trial else {}
        output = method(trial.context_images(), context, target, **info)
        return output._native if isinstance(output, Gaussians) else images(output)

    return call


def _takes_trial(method: Callable[..., Any]) -> bool:
    if isinstance(method, functools.partial) and "trial" in method.keywords:
        return False
    try:
        return "trial" in inspect.signature(_passed_to(method)).parameters
    except (TypeError, ValueError):
        return False


def _passed_to(method: Callable[..., Any]) -> Callable[..., Any]:
    """What has the method's parameters: a module's call takes anything, and what it passes on says more."""
    if isinstance(method, functools.partial):
        return functools.partial(_passed_to(method.func), *method.args, **method.keywords)
    module = inner(method)
    return _passed_to(module) if module is not None else getattr(method, "forward", method)


def describe(error: BaseException) -> tuple[str, str]:
    """The reason in a failed row: the exception, and the last line of the method's code that raised it."""
    if isinstance(error, NotApplicable):
        return "not-applicable", str(error)
    if isinstance(error, AtsplatError):
        return "failed", str(error)
    text = traceback.format_exception_only(error)[-1].strip()
    frames = traceback.extract_tb(error.__traceback__)
    of_method = [frame for frame in frames if os.path.dirname(frame.filename) != os.path.dirname(__file__)]
    place = f" ({os.path.basename(of_method[-1].filename)}:{of_method[-1].lineno})" if of_method else ""
    return "failed", f"{text}{place}"
