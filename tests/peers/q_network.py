"""Reference for the paper's Q-attention network: one forward and one backward pass of a narrow one and of the one that the preset
`paper` names, in PyTorch with float64.

    pip install torch==2.15.0
    python tests/peers/q_network.py           # writes tests/golden/q_network.json

Nothing here is shared with the Rust code. Weights and inputs follow formulas, so the golden file holds results only.
"""

import json
import math
import pathlib

import torch
import torch.nn.functional as F

torch.set_default_dtype(torch.float64)
GOLDEN = pathlib.Path(__file__).parent.parent / "golden"
BATCH = 2
# Gradients of a tensor that are kept of the wide network, evenly apart.
KEPT = 32


def wave(n, step, start):
    return torch.tensor([math.sin(step * i + start) for i in range(n)])


def noise(n, step, start):
    """Without the pattern of a wave, whose gradients in the wide network cancel: even f32 in PyTorch then differs from f64 by more
    than any of them, with these by 1.1e-5 of the largest of a tensor."""
    values = [math.sin(step * 12.9898 * i + 78.233 * (start + 1)) * 43758.5453 for i in range(n)]
    return torch.tensor([2 * (v - math.floor(v)) - 1 for v in values])


class Parameters:
    """Parameters in the order in which they are asked for: tensor k holds numbers(n, 0.7, 1.3 k) / sqrt(fan in)."""

    def __init__(self, bottleneck, numbers):
        self.tensors, self.bottleneck, self.numbers = [], bottleneck, numbers

    def make(self, shape, fan_in):
        values = self.numbers(math.prod(shape), 0.7, 1.3 * len(self.tensors)) / math.sqrt(fan_in)
        self.tensors.append(values.reshape(shape).requires_grad_())
        return self.tensors[-1]

    def conv(self, c_in, c_out, kernel):
        weight = self.make([c_out, c_in] + [kernel] * 3, c_in * kernel**3)
        bias = self.make([c_out], c_in * kernel**3)

        def apply(x):
            pad = kernel // 2
            return F.conv3d(F.pad(x, [pad] * 6, mode="replicate") if pad else x, weight, bias)

        return apply

    def dense(self, n_in, n_out):
        weight = self.make([n_in, n_out], n_in)
        bias = self.make([n_out], n_in)
        return lambda x: x @ weight + bias

    def inception(self, c_in, c_out):
        point = self.conv(c_in, c_out // 2, 1)
        b = self.bottleneck
        near = [self.conv(c_in, b, 1), self.conv(b, c_out // 4, 3)]
        far = [self.conv(c_in, b, 1), self.conv(b, b, 3), self.conv(b, c_out // 4, 3)]

        def branch(layers, x):
            for layer in layers:
                x = leaky(layer(x))
            return x

        return lambda x: torch.cat([branch([point], x), branch(near, x), branch(far, x)], 1)


def leaky(x):
    return F.leaky_relu(x, 0.02)


def spatial_softmax(x):
    b, c = x.shape[:2]
    attention = F.softmax(x.reshape(b, c, -1) / 0.01, -1).reshape(x.shape)
    axes = []
    for axis in (4, 3, 2):
        line = torch.linspace(-1, 1, x.shape[axis])
        others = [a for a in (2, 3, 4) if a != axis]
        axes.append((attention.sum(others) * line).sum(-1))
    return torch.stack(axes, -1).reshape(b, 3 * c)


def run(numbers, side, channels, bottleneck, width, bins):
    """Parameters with gradients, the values of voxels and pose, and the loss."""
    p = Parameters(bottleneck, numbers)
    c = channels
    first = p.inception(10, c)
    proprio = p.dense(11, c)
    down = [p.inception(2 * c, c), p.inception(c, 2 * c), p.inception(2 * c, 4 * c)]
    up = [(p.inception(4 * c, c), p.inception(c, c)), (p.inception(3 * c, c), p.inception(c, c))]
    merge, translation = p.conv(2 * c, c, 3), p.conv(c, 1, 3)
    hidden = [p.dense(32 * c, width), p.dense(width, width)]
    out = p.dense(width, 3 * bins + 2)

    voxels = numbers(BATCH * 10 * side**3, 0.11, 0.5).reshape(BATCH, 10, side, side, side)
    low_dim = numbers(BATCH * 11, 0.3, 0.0).reshape(BATCH, 11)
    tiled = leaky(proprio(low_dim))[:, :, None, None, None].expand(-1, -1, side, side, side)
    pool = lambda x: F.max_pool3d(x, 3, 2, 1)
    double = lambda x: F.interpolate(x, scale_factor=2, mode="trilinear", align_corners=False)
    d0 = down[0](torch.cat([first(voxels), tiled], 1))
    d1 = down[1](pool(d0))
    d2 = down[2](pool(d1))
    u2 = up[0][1](double(up[0][0](d2)))
    u1 = up[1][1](double(up[1][0](torch.cat([u2, d1], 1))))
    last = leaky(merge(torch.cat([u1, d0], 1)))
    q = translation(last).reshape(BATCH, -1)
    x = torch.cat([f for m in (d0, d1, d2, last) for f in (spatial_softmax(m), m.amax((2, 3, 4)))], 1)
    for layer in hidden:
        x = leaky(layer(x))
    pose = out(x)

    loss = (q**2).mean() + (pose**2).mean()
    loss.backward()
    return p.tensors, q, pose, loss


def outputs(q, pose, loss, step):
    return {
        "translation": [round(v, 7) for v in q.reshape(-1)[::step].tolist()],
        "pose": [round(v, 7) for v in pose.reshape(-1).tolist()],
        "loss": loss.item(),
    }


def main():
    tensors, *found = run(wave, side=8, channels=4, bottleneck=3, width=5, bins=4)
    # One number per parameter tensor: its gradient along a wave.
    slopes = [(t.grad.reshape(-1) * wave(t.numel(), 0.9, 0.2)).sum().item() for t in tensors]
    golden = outputs(*found, 7) | {"slopes": [round(v, 8) for v in slopes]}

    tensors, *found = run(noise, side=16, channels=64, bottleneck=32, width=128, bins=72)
    gradients = []
    for tensor in tensors:
        flat = tensor.grad.reshape(-1)
        kept = flat[:: max(1, flat.numel() // KEPT)].tolist()
        gradients.append({"largest": float(f"{flat.abs().max():.7g}"), "kept": [float(f"{v:.7g}") for v in kept]})
    golden["paper"] = outputs(*found, 61) | {"gradients": gradients}
    (GOLDEN / "q_network.json").write_text(json.dumps(golden) + "\n")


if __name__ == "__main__":
    main()
