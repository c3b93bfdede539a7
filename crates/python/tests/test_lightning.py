"""The callback of Lightning, with the hooks that its trainer calls; skipped without PyTorch, but Lightning itself is not needed."""

import sys
import types

import pytest
from conftest import INDEX, PROTOCOL

import atsplat

pytest.importorskip("torch")


@pytest.fixture
def callback(monkeypatch):
    """Makes the callback of an evaluation."""
    pytorch = types.ModuleType("lightning.pytorch")
    pytorch.Callback = object
    monkeypatch.setitem(sys.modules, "lightning", types.ModuleType("lightning"))
    monkeypatch.setitem(sys.modules, "lightning.pytorch", pytorch)
    monkeypatch.delitem(sys.modules, "atsplat.lightning", raising=False)
    from atsplat.lightning import EvaluationCallback

    yield EvaluationCallback
    monkeypatch.delitem(sys.modules, "atsplat.lightning")


class Strategy:
    """Sends what the first process sends; of the others, the process is the same here."""

    sent = ()

    def broadcast(self, value):
        if not self.sent:
            self.sent = (value,)
        return self.sent[0]


class FSDPStrategy(Strategy):
    pass


class Sharded(FSDPStrategy):
    pass


def trainer(step, first=True, processes=1, strategy=None):
    return types.SimpleNamespace(global_step=step, is_global_zero=first, world_size=processes, strategy=strategy)


def test_each_step_is_evaluated_once(rooms, tmp_path, callback):
    from test_torch import Blend

    from atsplat.torch import Evaluation

    check = Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=2, index=INDEX, limit=1)
    of = callback(check)
    for step, first in [(1, True), (2, True), (2, True), (4, False)]:
        # One process has no one to speak to.
        of.on_train_batch_end(trainer(step, first), Blend(), None, None, 0)
    assert sorted(check.stores) == [2]


class Failing:
    """An evaluation of every second step."""

    def __init__(self, error):
        self.error, self.calls = error, []

    def is_due(self, step):
        return step % 2 == 0

    def __call__(self, step, method):
        self.calls.append((step, method))
        if self.error is not None:
            raise self.error


@pytest.mark.parametrize("error", [None, atsplat.InvalidError("out: the disk is full"), ZeroDivisionError("mine")])
def test_all_processes_end_with_the_first(callback, error):
    check, strategy, raised = Failing(error), Strategy(), []
    for rank in range(3):
        try:
            of = callback(check, method=lambda module: f"{module} {rank}")
            of.on_train_batch_end(trainer(1, rank == 0, 3), "model")
            of.on_train_batch_end(trainer(2, rank == 0, 3, strategy), "model")
        except Exception as found:
            raised.append(found)
    assert check.calls == [(2, "model 0")] and strategy.sent == (error and f"{type(error).__name__}: {error}",)
    if error is None:
        assert raised == []
    else:
        assert raised[0] is error and len(raised) == 3
        for other in raised[1:]:
            assert isinstance(other, atsplat.AtsplatError) and f"on the first process: {type(error).__name__}" in str(other)


def test_a_model_in_parts_is_rejected_before_it_is_trained(callback):
    of = callback(Failing(None))
    of.on_fit_start(trainer(0, processes=2, strategy=Strategy()), "model")
    of.on_fit_start(trainer(0, processes=1, strategy=Sharded()), "model")
    for first in (True, False):
        with pytest.raises(atsplat.InvalidError, match="FSDPStrategy: evaluate its checkpoints") as raised:
            of.on_fit_start(trainer(0, first, 2, Sharded()), "model")
        assert raised.value.field == "strategy"
