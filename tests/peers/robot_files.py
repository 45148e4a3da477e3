"""Forward kinematics of every robot of the package example-robot-data against Pinocchio.

    make robots
    tests/peers/.venv/bin/python tests/peers/robot_files.py LPR

Of each URDF the chain with the most joints that have a motor, at most 16, is taken; its tip is named.
Every joint of it is drawn within its limits, 100 times; all others stand at 0 moved into their limits,
and joints that mimic another follow it. Both programs place the tip in the frame of the root link.

The built-in arms are compared with the package's files of them, too, by the program itself: flange and
limits.
"""

import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin

N_CONFIGS = 100
MAX_JOINTS = 16
SHARE = Path(sys.prefix) / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
ROBOTS = SHARE / "cmeel.prefix" / "share" / "example-robot-data" / "robots"


class Joint:
    def __init__(self, element):
        self.name = element.get("name")
        self.type = element.get("type")
        self.parent = element.find("parent").get("link")
        self.child = element.find("child").get("link")
        mimic = element.find("mimic")
        self.mimic = None
        if mimic is not None:
            self.mimic = (
                mimic.get("joint"),
                float(mimic.get("multiplier", 1)),
                float(mimic.get("offset", 0)),
            )
        limit = element.find("limit")
        bounds = (0.0, 0.0) if limit is None else (float(limit.get("lower", 0)), float(limit.get("upper", 0)))
        self.lower, self.upper = (-np.pi, np.pi) if self.type == "continuous" else bounds

    def moves(self):
        return self.type in ("revolute", "prismatic", "continuous")

    def is_driven(self):
        return self.moves() and self.mimic is None

    def rest(self):
        return float(np.clip(0.0, self.lower, self.upper))


def joints_of(path):
    root = ET.fromstring(path.read_bytes())
    joints = [Joint(element) for element in root.findall("joint")]
    links = [element.get("name") for element in root.findall("link")]
    return {joint.child: joint for joint in joints}, links, {joint.name: joint for joint in joints}


def chain_to(above, link):
    chain = []
    while link in above:
        chain.append(above[link])
        link = above[link].parent
    return chain[::-1], link


def longest_chain(above, links):
    """Tip and joints of the longest chain that may be an arm."""
    parents = {joint.parent for joint in above.values()}
    best = None
    for link in links:
        if link in parents:
            continue
        chain, root = chain_to(above, link)
        if any(joint.type in ("floating", "planar") for joint in chain):
            continue
        n = sum(joint.is_driven() for joint in chain)
        if 1 <= n <= MAX_JOINTS and (best is None or n > best[0]):
            best = (n, link, chain, root)
    return best


def position(joint, values, by_name):
    if joint.mimic is not None:
        driver, multiplier, offset = joint.mimic
        if driver not in by_name:
            return joint.rest()
        return multiplier * position(by_name[driver], values, by_name) + offset
    return values.get(joint.name, joint.rest())


def pinocchio_poses(path, by_name, names, configs, root, tip):
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    poses = []
    for config in configs:
        values = dict(zip(names, config))
        q = pin.neutral(model)
        for idx, name in enumerate(model.names):
            joint = by_name.get(name)
            if idx == 0 or joint is None or not joint.moves():
                continue
            value = position(joint, values, by_name)
            at = model.idx_qs[idx]
            if model.nqs[idx] == 2:
                q[at : at + 2] = np.cos(value), np.sin(value)
            else:
                q[at] = value
        pin.framesForwardKinematics(model, data, q)
        poses.append(data.oMf[model.getFrameId(root)].inverse() * data.oMf[model.getFrameId(tip)])
    return poses


def compare(lpr, path, rng):
    above, links, by_name = joints_of(path)
    best = longest_chain(above, links)
    if best is None:
        return None
    _, tip, chain, root = best
    driven = [joint for joint in chain if joint.is_driven()]
    bounds = [(joint.lower, joint.upper) for joint in driven]
    configs = [[np.float32(rng.uniform(*bound)) for bound in bounds] for _ in range(N_CONFIGS)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "configs.json"
        file.write_text(json.dumps({"configs": [[float(q) for q in config] for config in configs]}))
        command = [lpr, "fk", "--robot", str(path), "--tip", tip, "--configs", str(file), "--json"]
        run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode != 0:
        return tip, len(driven), run.stderr.strip().splitlines()[-1]
    found = json.loads(run.stdout)["poses"]
    names = [joint.name for joint in driven]
    expected = pinocchio_poses(path, by_name, names, configs, root, tip)
    apart, turned = 0.0, 0.0
    for pose, other in zip(found, expected):
        quaternion = pin.Quaternion(np.array(pose["rotation_xyzw"], dtype=float))
        apart = max(apart, np.linalg.norm(np.array(pose["position"]) - other.translation))
        turned = max(turned, np.linalg.norm(pin.log3(quaternion.matrix().T @ other.rotation)))
    return tip, len(driven), (apart, turned)


# File and flange of the built-in arms. The xArm7's file writes 1.5708 where a right angle is: 4e-6 rad at
# each of its joints.
BUILT_IN = {
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_eef", 3e-5),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8", 1e-5),
}


def ask(lpr, *words):
    done = subprocess.run([lpr, *map(str, words), "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def compare_built_in(lpr, name, rng):
    file, flange, most_turned = BUILT_IN[name]
    of_file = ask(lpr, "robots", "--describe", ROBOTS / file, "--tip", flange)
    limits = np.array([joint["limits"] for joint in of_file["joints"]])
    own = next(robot["limits"] for robot in ask(lpr, "robots")["robots"] if robot["name"] == name)
    configs = rng.uniform(*limits.T, size=(N_CONFIGS, len(limits))).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "configs.json"
        asked.write_text(json.dumps({"configs": configs.tolist()}))
        poses = ask(lpr, "fk", "--robot", name, "--configs", asked)["poses"]
        others = ask(lpr, "fk", "--robot", ROBOTS / file, "--tip", flange, "--configs", asked)["poses"]
    apart, turned = 0.0, 0.0
    for pose, other in zip(poses, others):
        a, b = (pin.Quaternion(np.array(it["rotation_xyzw"], dtype=float)).matrix() for it in (pose, other))
        apart = max(apart, np.linalg.norm(np.subtract(pose["position"], other["position"])))
        turned = max(turned, np.linalg.norm(pin.log3(a.T @ b)))
    widest = np.abs(limits - own).max()
    agrees = apart <= 1e-5 and turned <= most_turned and widest <= 1e-5
    word = "" if agrees else "DIFFERS: "
    print(f"built-in {name}: {word}{apart:.1e} m, {turned:.1e} rad, limits {widest:.1e}")
    return agrees


def main():
    lpr, *only = sys.argv[1:]
    rng = np.random.default_rng(0)
    n_files = n_agree = 0
    for path in sorted(ROBOTS.rglob("*.urdf")):
        if only and not any(word in path.name for word in only):
            continue
        result = compare(lpr, path, rng)
        if result is None:
            print(f"{path.name}: no chain")
            continue
        n_files += 1
        tip, n_joints, found = result
        agrees = isinstance(found, tuple) and found[0] <= 1e-5 and found[1] <= 1e-5
        n_agree += agrees
        word = f"{found[0]:.1e} m, {found[1]:.1e} rad" if isinstance(found, tuple) else found
        print(f"{path.name}: {n_joints} joints to {tip}: {'' if agrees else 'DIFFERS: '}{word}")
    built_in = [compare_built_in(lpr, name, rng) for name in BUILT_IN if not only]
    print(f"{n_agree} of {n_files} agree")
    sys.exit(0 if n_agree == n_files and all(built_in) else 1)


if __name__ == "__main__":
    main()
