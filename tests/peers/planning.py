"""Checks what `lpr plan --json` printed with nothing of ours: kinematics, spheres and obstacles in numpy, f64.

Every path is looked at 128 times per radian. Prints how deep the arm's spheres are in an obstacle or in another link at the worst.

    lpr robots --describe ARM.urdf --srdf ARM.srdf --write-srdf found.srdf --json > arm.json
    lpr plan --robot ARM.urdf --srdf ARM.srdf --problems PROBLEMS.json --simplify --json > plans.json
    python tests/peers/planning.py ARM.urdf arm.json found.srdf PROBLEMS.json plans.json

Pairs of links that the program leaves out are those that it writes down. Joints outside the chain stand at 0.

numpy 2; the description must have spheres as collision geometry only.
"""

import json
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np

CHECKS_PER_RADIAN = 128


def numbers(text):
    return np.array([float(word) for word in text.split()])


def rotation(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def origin(element):
    found = element.find("origin")
    pose = np.eye(4)
    if found is not None:
        pose[:3, :3] = rotation(*numbers(found.get("rpy", "0 0 0")))
        pose[:3, 3] = numbers(found.get("xyz", "0 0 0"))
    return pose


def motion(axis, slides, q):
    """The motion about, or along, an axis, for every position."""
    axis = axis / np.linalg.norm(axis)
    motion = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
    if slides:
        motion[:, :3, 3] = q[:, None] * axis
        return motion
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sin, cos = np.sin(q)[:, None, None], np.cos(q)[:, None, None]
    motion[:, :3, :3] = np.eye(3) + sin * cross + (1 - cos) * (cross @ cross)
    return motion


class Arm:
    """Links with their spheres, joint by joint from the root."""

    def __init__(self, urdf, description, srdf):
        robot = ElementTree.parse(urdf).getroot()
        self.spheres, self.joints = {}, {}
        self.order = [joint["name"] for joint in json.load(open(description))["joints"]]
        for link in robot.findall("link"):
            places = [(origin(c)[:3, 3], float(c.find("geometry/sphere").get("radius"))) for c in link.findall("collision")]
            self.spheres[link.get("name")] = places
        for joint in robot.findall("joint"):
            child, parent = joint.find("child").get("link"), joint.find("parent").get("link")
            moves = joint.get("name") in self.order
            axis = numbers(joint.find("axis").get("xyz")) if moves else None
            slides = joint.get("type") == "prismatic"
            self.joints[child] = (parent, origin(joint), (joint.get("name"), axis, slides) if moves else None)
        pairs = ElementTree.parse(srdf).getroot().findall("disable_collisions")
        self.allowed = {frozenset((pair.get("link1"), pair.get("link2"))) for pair in pairs}

    def frames(self, configs):
        """`world_from_link` of every link, for every configuration."""
        frames = {}

        def place(link):
            if link not in frames:
                if link not in self.joints:
                    frames[link] = np.broadcast_to(np.eye(4), (len(configs), 4, 4))
                else:
                    parent, offset, moves = self.joints[link]
                    frame = place(parent) @ offset
                    if moves:
                        name, axis, slides = moves
                        frame = frame @ motion(axis, slides, configs[:, self.order.index(name)])
                    frames[link] = frame
            return frames[link]

        for link in self.spheres:
            place(link)
        return frames

    def carrier(self, link):
        """The first link of the body that a link is on."""
        while link in self.joints and not self.joints[link][2]:
            link = self.joints[link][0]
        return link

    def is_rigid(self, a, b):
        """True if no joint that moves is between two links."""
        return self.carrier(a) == self.carrier(b)


def signed_distance(points, problem):
    """Distance of points from the nearest obstacle, negative inside."""
    least = np.full(points.shape[:-1], np.inf)
    for sphere in problem.get("spheres", []):
        least = np.minimum(least, np.linalg.norm(points - sphere["center"], axis=-1) - sphere["radius"])
    for capsule in problem.get("capsules", []):
        a, b = np.array(capsule["a"]), np.array(capsule["b"])
        along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
        least = np.minimum(least, np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1) - capsule["radius"])
    for cuboid in problem.get("cuboids", []):
        x, y, z, w = np.array(cuboid["rotation_xyzw"]) / np.linalg.norm(cuboid["rotation_xyzw"])
        axes = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ])
        gap = np.abs((points - cuboid["center"]) @ axes) - cuboid["half_extents"]
        outside = np.linalg.norm(np.maximum(gap, 0), axis=-1)
        least = np.minimum(least, outside + np.minimum(gap.max(axis=-1), 0))
    return least


def densely(path):
    pieces = [path[:1]]
    for a, b in zip(path, path[1:]):
        n = max(1, int(np.ceil(np.linalg.norm(b - a) * CHECKS_PER_RADIAN)))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(pieces)


def depth(arm, problem, path):
    frames = arm.frames(densely(path))
    worst = 0.0
    placed = {
        link: [(np.einsum("nij,j->ni", frames[link][:, :3, :3], center) + frames[link][:, :3, 3], radius) for center, radius in spheres]
        for link, spheres in arm.spheres.items()
    }
    for link, spheres in placed.items():
        for center, radius in spheres:
            if arm.carrier(link) in arm.joints:
                worst = max(worst, (radius - signed_distance(center, problem)).max())
    links = list(placed)
    for i, a in enumerate(links):
        for b in links[i + 1 :]:
            if frozenset((a, b)) in arm.allowed or arm.is_rigid(a, b):
                continue
            for center_a, radius_a in placed[a]:
                for center_b, radius_b in placed[b]:
                    worst = max(worst, (radius_a + radius_b - np.linalg.norm(center_a - center_b, axis=-1)).max())
    return worst


def main():
    urdf, description, srdf, problems, plans = sys.argv[1:]
    arm = Arm(urdf, description, srdf)
    by_name = {problem["name"]: problem for problem in json.load(open(problems))["problems"]}
    depths = []
    for result in json.load(open(plans))["results"]:
        if result["solved"]:
            path, problem = np.array(result["path"]), by_name[result["name"]]
            # What is beyond a limit by rounding is at the limit.
            assert np.allclose(path[0], problem["start"], atol=1e-4)
            assert any(np.allclose(path[-1], goal, atol=1e-4) for goal in problem["goals"])
            depths.append(depth(arm, problem, path))
    depths = np.array(depths) * 1000
    print(f"{len(depths)} paths; {np.sum(depths > 0)} touch something, {np.sum(depths > 2)} by more than 2 mm; worst {depths.max():.2f} mm")


if __name__ == "__main__":
    main()
