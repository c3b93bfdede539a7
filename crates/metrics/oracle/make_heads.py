"""LPIPS's heads v0.1 from the lpips package into the safetensors files of ../weights.

pip install lpips==0.1.4 torch safetensors; python make_heads.py
"""

from pathlib import Path

import lpips
import torch
from safetensors.torch import save_file

package = Path(lpips.__file__).parent
weights = Path(__file__).resolve().parent.parent / "weights"
for net in ["vgg", "alex"]:
    heads = torch.load(package / f"weights/v0.1/{net}.pth", map_location="cpu")
    save_file({name: tensor.contiguous() for name, tensor in heads.items()}, weights / f"lpips-v0.1-{net}.safetensors")
