"""`lpr bench networks` beside PyTorch on the CPU, in turn: the U-Net and the ranker, with one and two threads.

    tests/python.sh peers/pytorch
    tests/peers/pytorch/.venv/bin/python tests/peers/pytorch/beside.py target/release/lpr [TURNS]

Each turn is one run of either program with either number of threads; a row is the median of the medians of its turns, and the
least of all runs. Of the two layouts of PyTorch's convolutions the quicker counts.
"""

import json
import os
import statistics
import subprocess
import sys
import time

THREADS = (1, 2)
TURNS = 4
# As `lpr bench` measures: one run that is not counted, then at least so many, until so much time has passed.
MIN_RUNS, SECONDS = 5, 1.0


def measure(run):
    run()
    begin, millis = time.perf_counter(), []
    while len(millis) < MIN_RUNS or time.perf_counter() - begin < SECONDS:
        start = time.perf_counter()
        run()
        millis.append((time.perf_counter() - start) * 1e3)
    return statistics.median(millis), min(millis)


def pytorch(threads):
    """Median and least milliseconds of each row."""
    import torch
    import torch.nn.functional as F
    from torch import nn

    torch.set_num_threads(threads)

    class UNet(nn.Module):
        def __init__(self):
            super().__init__()
            conv = lambda c_in, c_out, stride=1: nn.Conv3d(c_in, c_out, 3, stride, padding=1)
            self.c1, self.c2 = conv(10, 32), conv(32, 32)
            self.d1, self.d1b = conv(32, 64, 2), conv(64, 64)
            self.d2, self.d2b = conv(64, 64, 2), conv(64, 64)
            self.u1, self.u2 = conv(128, 64), conv(96, 32)
            self.q = nn.Conv3d(32, 1, 1)
            self.head = nn.Sequential(nn.Linear(96, 256), nn.ReLU(inplace=True), nn.Linear(256, 218))

        def forward(self, x):
            relu = lambda x: F.relu(x, inplace=True)
            join = lambda low, high: torch.cat([F.interpolate(low, scale_factor=2), high], 1)
            c = relu(self.c2(relu(self.c1(x))))
            d1 = relu(self.d1b(relu(self.d1(c))))
            d2 = relu(self.d2b(relu(self.d2(d1))))
            u = relu(self.u2(join(relu(self.u1(join(d2, d1))), c)))
            features = torch.cat([d2.mean((2, 3, 4)), u.amax((2, 3, 4))], 1)
            return self.q(u), self.head(features)

    class Ranker(nn.Module):
        def __init__(self):
            super().__init__()
            mlp = lambda *widths: [m for a, b in zip(widths, widths[1:]) for m in (nn.Linear(a, b), nn.ReLU(inplace=True))]
            self.encoder = nn.Sequential(*mlp(7, 64, 128, 1024))
            self.head = nn.Sequential(*mlp(1024, 512, 512), nn.Linear(512, 1))

        def forward(self, paths):
            return (self.head(self.encoder(paths).amax(1)),)

    def training(network, x):
        optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)

        def update():
            optimizer.zero_grad()
            sum(output.square().mean() for output in network(x)).backward()
            optimizer.step()

        return update

    def inference(network, x):
        def infer():
            with torch.inference_mode():
                network(x)

        return infer

    torch.manual_seed(0)
    rows = {}
    for layout, memory_format in [("", torch.contiguous_format), (" channels last", torch.channels_last_3d)]:
        network = UNet().to(memory_format=memory_format)
        grid = lambda n: torch.rand(n, 10, 16, 16, 16).to(memory_format=memory_format)
        rows["unet_train_b16" + layout] = measure(training(network, grid(16)))
        rows["unet_infer_b1" + layout] = measure(inference(network, grid(1)))
    for length in (30, 100):
        rows[f"ranker_train_b128_t{length}"] = measure(training(Ranker(), torch.rand(128, length, 7)))
    return rows


def ours(lpr, threads):
    report = subprocess.check_output([lpr, "bench", "networks", "--threads", str(threads), "--json"])
    return {row["name"]: (row["median_ms"], row["min_ms"]) for row in json.loads(report)["results"]}


def theirs(threads):
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    return json.loads(subprocess.check_output([sys.executable, __file__, "--pytorch", str(threads)], env=environment))


def summary(turns, name):
    """Median of the medians, and least."""
    return statistics.median(turn[name][0] for turn in turns), min(turn[name][1] for turn in turns)


def main(lpr, n_turns):
    print(f"{'row':<24} {'threads':>7} {'lpr ms':>16} {'PyTorch ms':>16} {'medians':>8} {'least':>6}  layout")
    for threads in THREADS:
        turns = [(ours(lpr, threads), theirs(threads)) for _ in range(n_turns)]
        our_turns, their_turns = zip(*turns)
        for name in ("unet_train_b16", "unet_infer_b1", "ranker_train_b128_t30", "ranker_train_b128_t100"):
            layouts = [row for row in their_turns[0] if row.startswith(name)]
            best = min(layouts, key=lambda row: summary(their_turns, row)[0])
            (a, least_a), (b, least_b) = summary(our_turns, name), summary(their_turns, best)
            milliseconds = lambda median, least: f"{median:.1f} ({least:.1f})"
            print(
                f"{name:<24} {threads:>7} {milliseconds(a, least_a):>16} {milliseconds(b, least_b):>16} "
                f"{a / b:>8.2f} {least_a / least_b:>6.2f}  {best[len(name):].strip()}",
                flush=True,
            )


if __name__ == "__main__":
    if sys.argv[1] == "--pytorch":
        print(json.dumps(pytorch(int(sys.argv[2]))))
    else:
        main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else TURNS)
