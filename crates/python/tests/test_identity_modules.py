"""What a module of PyTorch or Lightning is: with another weight, setting or hook, a method is another one; skipped without PyTorch."""

import dataclasses
import sys
import types
import warnings

import pytest

import atsplat
from atsplat import _modules
from atsplat._identity import examined, identity, modules

torch = pytest.importorskip("torch")


def linear(weight=1.0):
    made = torch.nn.Linear(1, 1)
    torch.nn.init.constant_(made.weight, weight)
    torch.nn.init.zeros_(made.bias)
    return made


class Holding(torch.nn.Module):
    """A user's module with anything in it."""

    def __init__(self, **held):
        super().__init__()
        for name, value in held.items():
            setattr(self, name, value)

    def forward(self, images, context, target):
        return images


class Hidden(Holding):
    """Leaves a frozen module out of its state, as is usual."""

    def state_dict(self, *args, **options):
        return {name: value for name, value in super().state_dict(*args, **options).items() if not name.startswith("frozen")}


class Extra(Holding):
    def get_extra_state(self):
        return {"levels": {1, 2}, "gain": self.__dict__["gain"]}


def decoder(activation):
    torch.manual_seed(0)
    return torch.nn.TransformerDecoderLayer(8, 2, activation=activation)


def patched(gain):
    made = linear()
    made.forward = lambda x: x * gain
    return made


def hooked(gain, register="register_forward_hook"):
    made = linear()
    getattr(made, register)(lambda *values: values[-1])
    getattr(made, register)(lambda *values: values[-1] * gain)
    return made


def buffered(value, persistent):
    made = torch.nn.Module()
    made.register_buffer("k", value, persistent=persistent)
    return made


def configured(gain):
    made = linear()
    made.config = {"levels": [1, {"gain": gain}]}
    return made


#: Each takes 1 or 2.
MODULES = {
    "a buffer outside of state_dict": lambda k: buffered(torch.tensor(float(k)), False),
    "a submodule outside of state_dict": lambda k: Hidden(frozen=linear(k)),
    "what else is in state_dict": lambda k: Extra(gain=k),
    "a sparse buffer": lambda k: buffered(torch.eye(3).to_sparse() * k, True),
    "a sparse buffer in rows": lambda k: buffered((torch.eye(3) * k).to_sparse_csr(), True),
    "a quantized buffer": lambda k: buffered(torch.quantize_per_tensor(torch.ones(3) * k, 0.1, 0, torch.qint8), True),
    "a conjugate buffer": lambda k: buffered(torch.tensor([k + 1j]).conj(), True),
    "an activation": lambda k: decoder(("relu", "gelu")[k - 1]),
    "a replaced forward": patched,
    "a hook": hooked,
    "a hook before": lambda k: hooked(k, "register_forward_pre_hook"),
    "a nested setting": configured,
    "a list": lambda k: Holding(views=[1, k]),
    "a submodule chosen": lambda k: (lambda nets: Holding(nets=nets, head=lambda x: nets[k - 1].part))(
        [Holding(part=linear(1)), Holding(part=linear(2))]),
}


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::FutureWarning", "ignore::DeprecationWarning")
@pytest.mark.parametrize("make", MODULES.values(), ids=MODULES)
@pytest.mark.parametrize("place", [lambda module: module, lambda module: Holding(inner=module)], ids=["itself", "inside"])
def test_weights_settings_and_hooks_of_modules_count(make, place):
    one, same, two = (examined(place(make(number))) for number in (1, 1, 2))
    assert one == same and one[0] != two[0] and one[1] == []


def test_a_module_of_two_networks_is_not_that_of_the_other():
    def through(nets, head):
        return lambda images, context, target: head(nets[0](images) + nets[1](images))

    nets = [Holding(head=linear(1)), Holding(head=linear(2))]
    assert identity(through(nets, nets[0].head)) != identity(through(nets, nets[1].head))


def test_what_libraries_modules_hold_beside_settings_is_a_warning():
    changing, configured = linear(), linear()
    changing.seen, configured.config = torch.zeros(3), types.MappingProxyType({})
    configured.generator = torch.Generator()
    assert examined(Holding(inner=changing))[1] == ["torch.nn.modules.linear.Linear"]
    assert examined(Holding(inner=configured))[1] == ["torch._C.Generator"]
    graph = torch.fx.symbolic_trace(torch.nn.Sequential(linear()))
    assert [name.split(".")[-1] for name in examined(Holding(inner=graph))[1]] == ["GraphModuleImpl"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scripted = torch.jit.script(linear())
    assert examined(Holding(inner=scripted))[1] == ["torch.jit._script.RecursiveScriptModule"]


def test_wrappers_of_pytorch_leave_the_module_what_it_is():
    net = Holding(inner=linear())
    for wrap in (torch.compile, torch.nn.DataParallel):
        assert examined(wrap(net)) == examined(wrap(Holding(inner=linear())))
        assert identity(wrap(net)) != identity(wrap(Holding(inner=linear(2)))) and examined(wrap(net))[1] == []
    before = identity(net)
    net.compile()
    assert identity(net) == before


def test_modules_are_hashed_once_for_two_walks_and_not_to_find_them(monkeypatch):
    hashed, original = [], _modules.tensor
    monkeypatch.setattr(_modules, "tensor", lambda value: hashed.append(value) or original(value))
    net, calls = Holding(inner=linear(), constant=torch.zeros(2)), 0

    def counting(images, context, target):
        nonlocal calls
        calls += 1
        return net(images, context, target)

    assert modules(counting) == [net] and hashed == []
    identity(counting)
    assert len(hashed) == 3


def test_what_cannot_be_gone_through_needs_named_modules():
    nested = []
    for _ in range(3000):
        nested = [nested]
    with pytest.raises(atsplat.InvalidError, match="give module=…") as raised:
        modules(lambda images, context, target: nested)
    assert raised.value.field == "method"


@dataclasses.dataclass
class Config:
    gain: float


class LightningModule(torch.nn.Module):
    """As far as identities see it, where Lightning is not installed."""

    __module__ = "lightning.pytorch"

    def __init__(self):
        super().__init__()
        self._trainer = None

    def save_hyperparameters(self, *names):
        caller = sys._getframe(1).f_locals
        self._hparams = {name: caller[name] for name in names}


@pytest.mark.parametrize("is_installed", [False, True])
def test_the_configuration_of_a_lightning_module_counts(is_installed):
    base = pytest.importorskip("lightning").LightningModule if is_installed else LightningModule

    class Lit(base):
        def __init__(self, gain, **held):
            super().__init__()
            self.save_hyperparameters("gain")
            self.net = linear()
            for name, value in held.items():
                setattr(self, name, value)

        def forward(self, images, context, target):
            return images

        predict = forward

    def of(**held):
        return Lit(1.0, **held)

    def renderer(net):
        return types.SimpleNamespace(net=net)

    for make in (Lit, lambda gain: of(cfg=Config(gain)), lambda gain: of(cfg={"gain": gain}), lambda gain: of(views=[1, gain]),
                 lambda gain: of(_gain=gain), lambda gain: of(plain=torch.tensor(gain)), lambda gain: of(renderer=renderer(linear(gain)))):
        for way in (lambda module: module, lambda module: module.predict):
            one, same, two = (examined(way(make(gain))) for gain in (1.0, 1.0, 2.0))
            assert one == same and one[0] != two[0] and one[1] == []
    trained = of()
    trained._trainer = object()
    assert examined(trained) == examined(of())
    wrapped = of(renderer=renderer(linear()))
    assert modules(wrapped) == [wrapped, wrapped.renderer.net], "also one that is none of its modules"


def test_lightning_s_own_attributes_may_change():
    lightning = pytest.importorskip("lightning")

    class Lit(lightning.LightningModule):
        def __init__(self):
            super().__init__()
            self.net = linear()

        def training_step(self, batch, at):
            loss = self.net(batch).mean()
            self.log("loss", loss)
            return loss

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), lr=0.0)

    found = []

    class Looking(lightning.Callback):
        def on_train_batch_end(self, trainer, module, *_):
            found.append(examined(module))

    module = Lit()
    found.append(examined(module))
    quiet = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False, "enable_model_summary": False}
    trainer = lightning.Trainer(max_steps=2, accelerator="cpu", callbacks=[Looking()], **quiet)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trainer.fit(module, torch.utils.data.DataLoader(torch.zeros(2, 1)))
    assert len(found) == 3 and found[0] == found[1] == found[2] == examined(module)
