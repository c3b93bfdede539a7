"""Writes `../tests/fixtures/files/*.pt`: checkpoints as PyTorch saves them, for the importer.

    python make_checkpoints.py

`training.pt` nests a state dict in a training checkpoint with an optimiser's state, in all element types and
with strided views; `legacy.pt` is the same in the format before PyTorch 1.6; `executable.pt` would run code.
Values are those of `hashed.py` under seed 21, which the Rust test makes too.
"""

from pathlib import Path

import torch

import hashed

OUT = Path(__file__).parent / "../tests/fixtures/files"


def tensor(name, *shape):
    return torch.from_numpy(hashed.weight(21, name, shape))


class Executable:
    def __reduce__(self):
        import os
        return os.system, ("true",)


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    state = {
        "module.first.weight": tensor("first.weight", 6, 4),
        "module.first.bias": torch.nn.Parameter(tensor("first.bias", 6).double()),
        "module.second.kernel": tensor("second.weight", 3, 6).T,  # a strided view of [3, 6]
        "module.third.weight": tensor("third.weight", 4, 2).half(),
        "module.fourth.weight": tensor("fourth.weight", 4, 2).bfloat16(),
        "module.steps": torch.tensor(1234),
    }
    storage = tensor("shared", 5, 4)
    state["module.row.weight"] = storage[2:4]
    training = {
        "epoch": 3,
        "state_dict": state,
        "optimizer": {"state": {0: {"exp_avg": torch.zeros(6, 4)}}, "param_groups": [{"lr": 1e-4, "params": [0]}]},
        "note": "made by make_checkpoints.py",
    }
    torch.save(training, OUT / "training.pt")
    torch.save(training, OUT / "legacy.pt", _use_new_zipfile_serialization=False)
    torch.save({"state_dict": state, "callback": Executable()}, OUT / "executable.pt")


if __name__ == "__main__":
    main()
