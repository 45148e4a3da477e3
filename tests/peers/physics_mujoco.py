"""How fast physics is beside MuJoCo: the scene of `physics_arm10_10ms` (lpr-core/src/sim/sweep.rs) in both, in turn, one thread.

    pip install mujoco==4.0.0 numpy==2.4.6
    cargo build --release --locked
    python tests/peers/physics_mujoco.py target/release/lpr

Our arm is kinematic: it is where the sweep says, without torques. MuJoCo's has masses, damping and position actuators, which is
what it is for; so a part of the ratio is what is not computed. Both have the same capsules and boxes, contacts between arm and
boxes but none within the arm, and ten boxes that lie on the table awake. MuJoCo's table is a plane, which costs it less than our
box costs us. Its options are its defaults but for the integrator, which its own models of arms use.
"""

import json
import math
import statistics
import subprocess
import sys
import time

import mujoco

from kinematics import XARM7

TURNS = 10
SECONDS_PER_TURN = 1.0
CONTROL_DT = 0.05
NAME = "physics_arm10_10ms"
START = [0.0, -0.6, 0.0, 0.9, 0.0, 1.5, 0.0]
AMPLITUDES = [0.5, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0]
FREQUENCY = 2.0
# Ends (metres, in the frame of the link) and radius of every capsule of links 1 to 7 and of the hand.
LINKS = [
    [((0, 0, -0.07), (0, 0, 0), 0.06)],
    [((0, 0, -0.02), (0, 0, 0.02), 0.06), ((0, -0.06, 0), (0, -0.17, 0), 0.055)],
    [((0, 0, -0.08), (0, 0, -0.05), 0.053), ((0, 0, -0.01), (0.0525, 0, 0), 0.053)],
    [((0, 0, 0), (0.0775, -0.07, 0), 0.05), ((0.0775, -0.11, 0), (0.0775, -0.17, 0), 0.048)],
    [((0, 0, -0.14), (0, 0, 0), 0.045)],
    [((0, 0, 0), (0.06, 0, 0), 0.045), ((0.076, 0.02, 0), (0.076, 0.05, 0), 0.04)],
    [
        ((0, 0, -0.03), (0, 0, -0.025), 0.036),
        ((0, 0, 0.03), (0, 0, 0.05), 0.038),
        ((0, -0.045, 0.075), (0, 0.045, 0.075), 0.028),
    ],
]
BASE = ((0, 0, 0.075), (0, 0, 0.12), 0.063)
GRIP_Z, MAX_WIDTH = 0.172, 0.085
# Centre behind the inner face of the pad, centre along z, half extents: pad and body of a finger, metres.
FINGER = [(0.004, 0.0, (0.011, 0.004, 0.0095)), (0.014, -0.0285, (0.0125, 0.006, 0.038))]


def numbers(values):
    return " ".join(f"{value:.9g}" for value in values)


def capsule(a, b, radius):
    return f'<geom class="robot" type="capsule" fromto="{numbers(a + b)}" size="{radius}"/>'


def finger(name, side):
    boxes = "".join(
        f'<geom class="robot" type="box" pos="{numbers((0, side * behind, z))}" size="{numbers(half)}"/>' for behind, z, half in FINGER
    )
    place = numbers((0, side * MAX_WIDTH / 2, GRIP_Z))
    joint = f'<joint name="{name}" type="slide" axis="0 {-side} 0" range="0 {MAX_WIDTH / 2}" damping="10" armature="0.1"/>'
    return f'<body pos="{place}">{joint}{boxes}</body>'


def arm():
    inner = finger("left", 1) + finger("right", -1)
    for idx in reversed(range(7)):
        xyz, quarter_turns, lower, upper = XARM7[idx]
        joint = f'<joint name="joint{idx}" axis="0 0 1" range="{lower} {upper}" damping="1" armature="0.1"/>'
        geoms = "".join(capsule(*shape) for shape in LINKS[idx])
        inner = f'<body pos="{numbers(xyz)}" euler="{quarter_turns * math.pi / 2} 0 0">{joint}{geoms}{inner}</body>'
    return capsule(*BASE) + inner


def boxes():
    places = [(0.3 + 0.1 * (idx % 5), 0.15 + 0.1 * (idx // 5), 0.02) for idx in range(10)]
    return "".join(
        f'<body pos="{numbers(place)}"><freejoint/><geom class="scene" type="box" size="0.02 0.02 0.02" mass="0.1"/></body>' for place in places
    )


def scene(dt):
    actuators = [f'<position joint="joint{idx}" kp="2000" kv="200"/>' for idx in range(7)]
    actuators += [f'<position joint="{name}" kp="500" kv="20"/>' for name in ("left", "right")]
    return f"""
    <mujoco>
      <compiler angle="radian"/>
      <option timestep="{dt}" integrator="implicitfast"/>
      <default>
        <default class="robot"><geom contype="2" conaffinity="1" friction="1"/></default>
        <default class="scene"><geom contype="1" conaffinity="3" friction="0.5"/></default>
      </default>
      <worldbody><geom class="scene" type="plane" size="2 2 0.1"/>{arm()}{boxes()}</worldbody>
      <actuator>{"".join(actuators)}</actuator>
    </mujoco>"""


class Peer:
    """MuJoCo at one step size."""

    def __init__(self, dt):
        self.dt = dt
        self.model = mujoco.MjModel.from_xml_string(scene(dt))
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:7] = START
        self.data.ctrl[:7] = START
        self.worst_lag = 0.0
        self.contacts = []

    def control_step(self):
        """50 ms of simulated time with one target, so that Python's own time hardly counts; returns seconds of wall time."""
        sine = math.sin(FREQUENCY * (self.data.time + CONTROL_DT))
        target = [start + amplitude * sine for start, amplitude in zip(START, AMPLITUDES)]
        steps = round(CONTROL_DT / self.dt)
        begin = time.perf_counter()
        self.data.ctrl[:7] = target
        mujoco.mj_step(self.model, self.data, nstep=steps)
        seconds = time.perf_counter() - begin
        self.worst_lag = max(self.worst_lag, *(abs(q - goal) for q, goal in zip(self.data.qpos[:7], target)))
        self.contacts.append(self.data.ncon)
        return seconds / steps

    def turn(self):
        """Seconds of one physics step: the median and the least over a turn."""
        times, begin = [], time.perf_counter()
        while time.perf_counter() - begin < SECONDS_PER_TURN:
            times.append(self.control_step())
        return statistics.median(times), min(times)


def ours(binary):
    printed = subprocess.run([binary, "bench", "simulation", "--threads", "1", "--json"], check=True, capture_output=True, text=True)
    row = next(row for row in json.loads(printed.stdout)["results"] if row["name"] == NAME)
    return row["median_ms"] * 1e-3, row["min_ms"] * 1e-3


def micros(turns):
    return {
        "median_micros": round(1e6 * statistics.median(median for median, _ in turns), 2),
        "least_micros": round(1e6 * min(least for _, least in turns), 2),
    }


def main():
    binary = sys.argv[1]
    peers = {10: Peer(0.01), 2: Peer(0.002)}
    turns = {"lpr": [], 10: [], 2: []}
    for _ in range(TURNS):
        turns["lpr"].append(ours(binary))
        for millis, peer in peers.items():
            turns[millis].append(peer.turn())
    report = {"mujoco": mujoco.__version__, "lpr_10ms": micros(turns["lpr"])}
    for millis, peer in peers.items():
        # Steps of `millis` that one of our steps of 10 ms stands for.
        steps = 10 / millis
        ratios = [steps * theirs[0] / own[0] for theirs, own in zip(turns[millis], turns["lpr"])]
        least = steps * min(least for _, least in turns[millis]) / min(least for _, least in turns["lpr"])
        report[f"mujoco_{millis}ms"] = {
            **micros(turns[millis]),
            "contacts": statistics.median(peer.contacts),
            "worst_lag_radians": round(peer.worst_lag, 4),
            "simulated_time_ratio": {"median": round(statistics.median(ratios), 2), "least_times": round(least, 2)},
        }
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
