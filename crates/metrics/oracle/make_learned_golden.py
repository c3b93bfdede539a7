"""LPIPS and ST-LPIPS by their own packages, on networks whose weights come from a seed (`seeded.uniform`).

pip install numpy pillow torch torchvision lpips==0.1.4 stlpips_pytorch==0.0.2 torchsummary ipython
python make_learned_golden.py > ../tests/fixtures/learned_golden.json

LPIPS has its real heads v0.1; ST-LPIPS's heads are |seeded|. A tensor's seed is its place in the list of convolutions.
lpips-vgg-inria is the number of gaussian-splatting's metrics.py: images through 8 bits, and not scaled from [0, 1] to [−1, 1].
"""

import json
import sys
import types

import lpips
import numpy as np
import torch
from PIL import Image
from seeded import IMAGES, render, uniform

sys.modules.setdefault("IPython", types.SimpleNamespace(embed=None))
import stlpips_pytorch.stlpips as stlpips

CASES = [("lossless.webp", None), ("baseline_444_q98.jpg", (0, 0, 36, 33))]


def seed_convolutions(model):
    place = 0
    for module in model.net.modules():
        if isinstance(module, torch.nn.Conv2d):
            fan_in = module.weight[0].numel()
            weight = uniform(2 * place, module.weight.numel(), (6.0 / fan_in) ** 0.5)
            bias = uniform(2 * place + 1, module.bias.numel(), 0.1)
            module.weight.data = torch.from_numpy(weight.reshape(module.weight.shape))
            module.bias.data = torch.from_numpy(bias)
            place += 1


def seed_heads(model):
    for place in range(5):
        weight = getattr(model, f"lin{place}").model[1].weight
        weight.data = torch.from_numpy(np.abs(uniform(1000 + place, weight.numel(), 1.0)).reshape(weight.shape))


def networks():
    for net in ["vgg", "alex"]:
        model = lpips.LPIPS(net=net, pnet_rand=True, verbose=False)
        seed_convolutions(model)
        yield f"lpips-{net}", model, True
        if net == "vgg":
            yield "lpips-vgg-inria", model, False
    for net in ["alex", "vgg"]:
        model = stlpips.LPIPS(net=net, variant="shift_tolerant", pretrained=False, verbose=False)
        model.eval()
        seed_convolutions(model)
        seed_heads(model)
        yield f"st-lpips-{net}", model, True


def rounded(values):
    """As torchvision's save_image writes them."""
    return np.floor(np.clip(values, 0, 1) * np.float32(255) + np.float32(0.5)) / np.float32(255)


golden = []
for name, model, scaled in networks():
    for case, (image, box) in enumerate(CASES):
        opened = Image.open(IMAGES / image).convert("RGB")
        samples = np.asarray(opened.crop((box[0], box[1], box[0] + box[2], box[1] + box[3])) if box else opened)
        pair = (render(samples, case), samples.astype(np.float32) / np.float32(255))
        pair = pair if scaled else tuple(rounded(values) for values in pair)
        tensors = [torch.from_numpy(v.transpose(2, 0, 1)[None].copy()) for v in pair]
        with torch.no_grad():
            value = model(*tensors, normalize=scaled)
            wide = model.double()(*[t.double() for t in tensors], normalize=scaled)
            model.float()
        golden.append({"network": name, "image": image, "box": box, "seed": case, "value": value.item(), "value_f64": wide.item()})
print(json.dumps(golden, indent=1))
