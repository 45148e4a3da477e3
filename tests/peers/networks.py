"""Reference for ranker and policy: one batch, three updates, in PyTorch with float64.

    pip install torch==2.15.0 numpy
    python tests/peers/networks.py            # writes tests/golden/ranker.json and tests/golden/policy.json

Nothing here is shared with the Rust code: features, networks, targets, clipping and Adam are written a second time.
"""

import json
import math
import pathlib

import torch

torch.set_default_dtype(torch.float64)
GOLDEN = pathlib.Path(__file__).parent.parent / "golden"
# Limits of the Panda, radians.
LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
UPDATES = 3


def rounded(x):
    """Numbers that f32 and JSON hold well."""
    return [round(float(v), 6) for v in x]


def random_path(generator, n_configs):
    lower, upper = torch.tensor(LOWER), torch.tensor(UPPER)
    u = torch.rand(n_configs, 7, generator=generator)
    return [rounded(row) for row in lower + u * (upper - lower)]


def random_goal(generator):
    q = torch.randn(4, generator=generator)
    return {
        "position": rounded(torch.rand(3, generator=generator)),
        "quaternion": rounded(q / q.norm()),  # x, y, z, w
        "gripper": ["open", "close"][int(torch.randint(2, (1,), generator=generator))],
    }


def scaled(configs):
    lower, upper = torch.tensor(LOWER), torch.tensor(UPPER)
    return 2 * (torch.tensor(configs) - lower) / (upper - lower) - 1


def goal_features(goal):
    x, y, z, w = goal["quaternion"]
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
    second = [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)]
    return torch.tensor(goal["position"] + first + second + [1.0 if goal["gripper"] == "open" else -1.0])


def mlp(widths, generator):
    layers = []
    for fan_in, fan_out in zip(widths, widths[1:]):
        layer = torch.nn.Linear(fan_in, fan_out)
        for parameter in layer.parameters():
            values = torch.randn(parameter.shape, generator=generator) / math.sqrt(fan_in)
            parameter.data = torch.tensor(rounded(values.flatten())).reshape(parameter.shape)
        layers.append(layer)
    return torch.nn.ModuleList(layers)


def run(layers, x):
    for layer in layers[:-1]:
        x = torch.relu(layer(x))
    return layers[-1](x)


def named(prefix, layers):
    tensors = []
    for idx, layer in enumerate(layers):
        weight = layer.weight.detach().T.contiguous()  # stored as [inputs, outputs]
        for name, value in [("weight", weight), ("bias", layer.bias.detach())]:
            flat = [round(v, 9) for v in value.flatten().tolist()]
            tensors.append({"name": f"{prefix}layers.{idx}.{name}", "shape": list(value.shape), "values": flat})
    return tensors


def clip_and_step(parameters, optimizer, adam):
    if isinstance(adam["clip"], dict):
        kind, limit = next(iter(adam["clip"].items()))
        clip = {"value": torch.nn.utils.clip_grad_value_, "norm": torch.nn.utils.clip_grad_norm_}[kind]
        clip(parameters, limit)
    optimizer.step()


class Critic(torch.nn.Module):
    def __init__(self, settings, generator):
        super().__init__()
        n_context = 27 if settings["input"] == "context" else 0
        self.encoder = mlp([7] + settings["config_widths"], generator)
        self.head = mlp([settings["config_widths"][-1] + n_context] + settings["head_widths"] + [1], generator)

    def forward(self, configs, context):
        pooled = torch.relu(run(self.encoder, configs)).max(dim=1).values
        return run(self.head, torch.cat([pooled, context], 1)).squeeze(1)

    def named(self, prefix):
        return named(prefix + "encoder.", self.encoder) + named(prefix + "head.", self.head)


def ranker_inputs(samples, settings):
    configs = torch.stack([scaled(sample["configs"]) for sample in samples])
    if settings["input"] == "joints":
        return configs, torch.zeros(len(samples), 0)
    context = [
        torch.cat([
            scaled(s["configs"])[0],
            scaled(s["configs"])[-1],
            goal_features(s["goal"]),
            torch.tensor([float(s["collides"]), s["gripper_open"], s["time"]]),
        ])
        for s in samples
    ]
    return configs, torch.stack(context)


def ranker_case(settings, seed):
    generator = torch.Generator().manual_seed(seed)

    def sample():
        number = lambda: float(torch.rand(1, generator=generator))
        return {
            "configs": random_path(generator, 5),
            "goal": random_goal(generator),
            "collides": number() < 0.5,
            "gripper_open": float(number() < 0.5),
            "time": round(2 * number() - 1, 6),
        }

    batch = []
    for idx in range(6):
        terminal = idx % 3 == 2
        weight = round(0.25 + 0.75 * float(torch.rand(1, generator=generator)), 6)
        reward = 1.0 if idx == 2 else 0.0
        batch.append({"taken": sample(), "reward": reward, "next": None if terminal else sample(), "weight": weight})

    n_critics = 2 if settings["critics"] == "twin" else 1
    online = torch.nn.ModuleList([Critic(settings, generator) for _ in range(n_critics)])
    target = torch.nn.ModuleList([Critic(settings, generator) for _ in range(n_critics)])
    state = lambda critics: [t for idx, critic in enumerate(critics) for t in critic.named(f"critics.{idx}.")]
    before = {"online": state(online), "target": state(target)}

    adam = settings["adam"]
    parameters = list(online.parameters())
    optimizer = torch.optim.Adam(parameters, lr=adam["learning_rate"], weight_decay=adam["l2"])
    taken = ranker_inputs([t["taken"] for t in batch], settings)
    weight = torch.tensor([t["weight"] for t in batch])
    values = torch.stack([critic(*taken) for critic in online]).mean(0).tolist()

    updates = []
    for _ in range(UPDATES):
        y = []
        for transition in batch:
            value = 0.0
            if transition["next"] is not None:
                inputs = ranker_inputs([transition["next"]], settings)
                value = min(critic(*inputs).item() for critic in target)
            value = transition["reward"] + settings["discount"] * value
            y.append(min(max(value, 0.0), 1.0) if settings["target_range"] == "unit_interval" else value)
        y = torch.tensor(y)
        q = [critic(*taken) for critic in online]
        loss = sum((weight * (y - value) ** 2).mean() for value in q)
        optimizer.zero_grad()
        loss.backward()
        clip_and_step(parameters, optimizer, adam)
        with torch.no_grad():
            for old, new in zip(target.parameters(), online.parameters()):
                old.mul_(1 - settings["target_mix"]).add_(settings["target_mix"] * new)
        updates.append({"loss": loss.item(), "td_errors": (y - torch.stack(q).mean(0)).tolist()})
    after = {"online": state(online), "target": state(target)}
    return {"settings": settings, "batch": batch, "before": before, "values": values, "updates": updates, "after": after}


def policy_case(settings, seed):
    generator = torch.Generator().manual_seed(seed)
    batch = [
        {"configs": random_path(generator, n), "goal": random_goal(generator), "weight": w}
        for n, w in [(5, 1.0), (3, 0.5), (5, 0.25)]
    ]
    network = mlp([25] + settings["widths"] + [7], generator)
    before = named("", network)

    def predict(start, end, goal, n):
        s = torch.linspace(0, 1, n).unsqueeze(1)
        rows = torch.cat([scaled(start), scaled(end), goal_features(goal)]).expand(n, -1)
        start, end = torch.tensor(start), torch.tensor(end)
        return start + s * (end - start) + 4 * s * (1 - s) * run(network, torch.cat([rows, 2 * s - 1], 1))

    first = batch[0]
    path = predict(first["configs"][0], first["configs"][-1], first["goal"], 7).tolist()
    adam = settings["adam"]
    parameters = list(network.parameters())
    optimizer = torch.optim.Adam(parameters, lr=adam["learning_rate"], weight_decay=adam["l2"])
    losses = []
    for _ in range(UPDATES):
        errors = [
            b["weight"] * (predict(b["configs"][0], b["configs"][-1], b["goal"], len(b["configs"])) - torch.tensor(b["configs"])).square().mean()
            for b in batch
        ]
        loss = sum(errors) / len(errors)
        optimizer.zero_grad()
        loss.backward()
        clip_and_step(parameters, optimizer, adam)
        losses.append(loss.item())
    return {"settings": settings, "batch": batch, "before": before, "path": path, "losses": losses, "after": named("", network)}


def adam(clip):
    return {"learning_rate": 0.01, "l2": 0.001, "clip": clip}


def main():
    common = {"config_widths": [6, 9], "head_widths": [8, 5], "discount": 0.99}
    paper = common | {"input": "joints", "critics": "single", "target_range": "unbounded", "target_mix": 0.1, "adam": adam("none")}
    context = common | {"input": "context", "critics": "twin", "target_range": "unit_interval", "target_mix": 0.3}
    cases = {
        "ranker": [
            ranker_case(paper, 1),
            ranker_case(context | {"adam": adam({"value": 0.01})}, 2),
            ranker_case(context | {"adam": adam({"norm": 0.1})}, 3),
        ],
        "policy": [policy_case({"widths": [8, 6], "adam": adam({"norm": 0.5})}, 4)],
    }
    for name, value in cases.items():
        (GOLDEN / f"{name}.json").write_text(json.dumps(value) + "\n")


if __name__ == "__main__":
    main()
