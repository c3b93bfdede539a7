"""PyTorch's tensors and modules: what they hold. PyTorch is not imported: who has one of these has imported it."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

from . import _members
from ._contents import attribute, digest
from ._files import root

#: Set by PyTorch and Lightning later than when a module is made.
_SET_LATER = frozenset({"_compiled_call_impl", "_is_torch_compile", "_hparams_initial", "_hparams_name"})
#: Their code is in none of their attributes.
_GENERATED = {"ScriptModule", "GraphModule"}
#: Packages that have it.
_LIGHTNING = ("lightning", "pytorch_lightning")
_HOOKS = ("_forward_pre_hooks", "_forward_hooks")


def tensor(value: Any) -> bytes:
    """The hash of a tensor's type, layout, shape and values, on whatever device."""
    torch: Any = sys.modules["torch"]
    value = value.detach()
    if value.is_nested:
        return digest(b"nested", *map(tensor, value.unbind()))
    kind = f"{value.dtype} {value.layout} {tuple(value.shape)}".encode()
    if value.is_meta:
        return digest(b"tensor without values", kind)
    if value.is_quantized:
        return digest(b"quantized", kind, tensor(value.int_repr()), tensor(value.dequantize()))
    if value.layout == torch.sparse_coo:
        value = value.coalesce()
        return digest(b"sparse", kind, tensor(value.indices()), tensor(value.values()))
    if value.layout in (torch.sparse_csr, torch.sparse_bsr):
        return digest(b"sparse", kind, *map(tensor, (value.crow_indices(), value.col_indices(), value.values())))
    if value.layout in (torch.sparse_csc, torch.sparse_bsc):
        return digest(b"sparse", kind, *map(tensor, (value.ccol_indices(), value.row_indices(), value.values())))
    if value.layout != torch.strided:
        return digest(b"dense", kind, tensor(value.to_dense()))
    # As bytes, because NumPy has no bfloat16.
    stored = value.cpu().resolve_conj().resolve_neg().contiguous().reshape(-1)
    return digest(b"tensor", kind, stored.view(torch.uint8).numpy().data)


def state(module: Any) -> list[tuple[str, Any]]:
    """What a module computes with, by name: parameters and buffers, of which ``state_dict`` may leave some out, and what else is in it."""
    held = dict(module.named_parameters(remove_duplicate=False))
    held |= dict(module.named_buffers(remove_duplicate=False))
    return sorted({**module.state_dict(), **held}.items(), key=lambda item: item[0])


def attributes(module: Any) -> dict[str, Any]:
    """The attributes that a module's user has set: not those by which PyTorch and Lightning work, which change while it trains."""
    lightning = next((of for of in type(module).__mro__ if of.__name__ == "LightningModule" and root(of.__module__) in _LIGHTNING), None)
    own = _SET_LATER | _attributes_of(sys.modules["torch"].nn.Module) | (_attributes_of(lightning) if lightning else frozenset())
    found = {key: value for key, value in _members.attributes(module).items() if key not in own}
    if not found.get("_hparams", True):
        # Made when someone looks for them.
        del found["_hparams"]
    return found


@functools.lru_cache(maxsize=8)
def _attributes_of(of: Callable[[], Any]) -> frozenset[str]:
    return frozenset(vars(of()))


def hooks(module: Any) -> list[Any]:
    """What is called before and after ``forward``; the keys are numbers that count all hooks of a process."""
    return [hook for key in _HOOKS for hook in (attribute(module, key) or {}).values()]


def is_generated(of: type) -> bool:
    """Whether modules of this class have code that is not in it."""
    return any(one.__name__ in _GENERATED for one in of.__mro__)
