"""DINOv2's vision transformer under its official parameter names, in float64.

Written from the description of the architecture; `make_dinov2_fixtures.py` compares it with Hugging Face's
implementation, which shares no code with it.
"""

import math

import torch
import torch.nn.functional as F

# channels, layers, heads, side of the stored positions
SIZES = {"tiny": (32, 2, 2, 3), "small": (384, 12, 6, 37), "base": (768, 12, 12, 37), "large": (1024, 24, 16, 37)}
PATCH, REGISTERS, EPS = 14, 4, 1e-6
MEAN, DEVIATION = torch.tensor([0.485, 0.456, 0.406]).double(), torch.tensor([0.229, 0.224, 0.225]).double()


def positions(embedding, side, rows, columns, registers):
    """The stored grid of positions [1, 1 + side * side, D] brought to another grid: [1, 1 + rows * columns, D]."""
    if rows == columns == side:
        return embedding
    grid = embedding[:, 1:].unflatten(1, (side, side)).permute(0, 3, 1, 2)
    if registers:
        grid = F.interpolate(grid, (rows, columns), mode="bicubic", antialias=True)
    else:
        # The offset of 0.1 changes the coordinates that are sampled, not only the rounding of the size.
        grid = F.interpolate(grid, scale_factor=((rows + 0.1) / side, (columns + 0.1) / side), mode="bicubic")
    assert grid.shape[2:] == (rows, columns)
    return torch.cat([embedding[:, :1], grid.permute(0, 2, 3, 1).flatten(1, 2)], 1)


def patch_tokens(p, images, size, registers):
    """Normalised last-layer patch tokens [V, patches, D] of images [V, H, W, 3] in 0..1."""
    dim, depth, heads, side = SIZES[size]
    x = ((images - MEAN) / DEVIATION).permute(0, 3, 1, 2)
    views, rows, columns = len(x), x.shape[2] // PATCH, x.shape[3] // PATCH
    x = F.conv2d(x, p("patch_embed.proj.weight", dim, 3, PATCH, PATCH), p("patch_embed.proj.bias", dim), stride=PATCH)
    x = torch.cat([p("cls_token", 1, 1, dim).expand(views, -1, -1), x.flatten(2).transpose(1, 2)], 1)
    x = x + positions(p("pos_embed", 1, side * side + 1, dim), side, rows, columns, registers)
    if registers:
        x = torch.cat([x[:, :1], p("register_tokens", 1, REGISTERS, dim).expand(views, -1, -1), x[:, 1:]], 1)
    for layer in range(depth):
        b = p.below(f"blocks.{layer}")
        x = x + b("ls1.gamma", dim) * attention(b.below("attn"), norm(b, "norm1", x, dim), dim, heads)
        h = F.gelu(linear(b, "mlp.fc1", norm(b, "norm2", x, dim), 4 * dim))
        x = x + b("ls2.gamma", dim) * linear(b, "mlp.fc2", h, dim)
    return norm(p, "norm", x, dim)[:, 1 + (REGISTERS if registers else 0):]


def attention(p, x, dim, heads):
    qkv = linear(p, "qkv", x, 3 * dim).unflatten(-1, (3, heads, dim // heads)).permute(2, 0, 3, 1, 4)
    weights = (qkv[0] @ qkv[1].transpose(-1, -2) / math.sqrt(dim // heads)).softmax(-1)
    return linear(p, "proj", (weights @ qkv[2]).transpose(1, 2).flatten(-2), dim)


def linear(p, name, x, outputs):
    return F.linear(x, p(f"{name}.weight", outputs, x.shape[-1]), p(f"{name}.bias", outputs))


def norm(p, name, x, dim):
    return F.layer_norm(x, (dim,), p(f"{name}.weight", dim), p(f"{name}.bias", dim), EPS)
