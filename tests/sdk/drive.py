"""Drives an emulated xArm7 with the vendor's SDK as its manual says, and prints what came back as JSON.

Usage: drive.py COMMAND STOP FAST NORMAL RICH REALTIME, the emulator's ports.
"""

import contextlib
import json
import socket
import sys
import time

from emulated import HOST, arm as connect, redirect

TARGET = [0.2, -0.5, 0.1, 0.8, -0.1, 1.4, 0.3]
FAR = [2.0, -0.5, 0.1, 0.8, -0.1, 1.4, 0.3]
STREAM = [[0.2 + 0.01 * i, -0.5, 0.1, 0.8, -0.1, 1.4, 0.3] for i in range(51)]
PATIENCE = 20


def wait_for(what):
    """Waits until `what` holds; says whether it came true."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if what():
            return True
        time.sleep(0.01)
    return False


def ready(arm, mode):
    codes = [arm.motion_enable(True), arm.set_mode(mode), arm.set_state(0)]
    # Reports come five times a second, and the SDK believes them.
    assert wait_for(lambda: arm.mode == mode and arm.state == 2)
    return codes


def same(a, b, tolerance=1e-4):
    return max(abs(x - y) for x, y in zip(a, b)) <= tolerance


def parsed(port):
    """One report of `port`, as the SDK's own structure reads it."""
    from xarm.x3.report import ReportDataStructure

    report = ReportDataStructure.create(port)
    with socket.create_connection((HOST, port), timeout=PATIENCE) as stream:
        data = stream.recv(len(report), socket.MSG_WAITALL)
    report.update(data)
    found = {"bytes": len(data), "data_size": report.data_size, "state": report.state, "mode": report.mode}
    return found | {"angles": list(report.actual_joint_angle), "position": list(report.actual_tcp_pose)[:3]}


def run():
    found = {}
    arm = connect("rich")
    found["version"] = arm.version
    found["axis"] = arm.axis
    found["ready"] = ready(arm, 0)

    found["move"] = arm.set_servo_angle(angle=TARGET, speed=2.0, mvacc=10.0, wait=True)
    found["angles"] = arm.get_servo_angle()
    found["position"] = arm.get_position()
    found["kinematics"] = arm.get_forward_kinematics(TARGET)
    found["home_pose"] = arm.get_forward_kinematics([0.0] * 7)
    found["inverse"] = arm.get_inverse_kinematics(found["position"][1])
    found["joint_states"] = arm.get_joint_states()
    found["rich_report"] = wait_for(lambda: same(arm.angles[:7], TARGET) and arm.state == 2)
    found["rich_position"] = arm.position

    x, y, z, *rpy = found["position"][1]
    found["line"] = arm.set_position(x, y + 30, z - 20, *rpy, speed=200, wait=True)
    found["line_end"] = arm.get_position()
    found["line_goal"] = [x, y + 30, z - 20]
    found["back"] = arm.set_servo_angle(angle=TARGET, speed=2.0, mvacc=10.0, wait=True)

    found["servo_mode"] = ready(arm, 1)
    found["servo"] = []
    for point in STREAM:
        found["servo"].append(arm.set_servo_angle_j(point))
        time.sleep(0.01)
    found["servo_arrived"] = wait_for(lambda: same(arm.get_servo_angle()[1], STREAM[-1]))
    found["servo_angles"] = arm.get_servo_angle()

    found["gripper_setup"] = [arm.set_gripper_mode(0), arm.set_gripper_enable(True), arm.set_gripper_speed(5000)]
    found["gripper"] = []
    for position in [850, 0, 600]:
        code = arm.set_gripper_position(position, wait=True, timeout=PATIENCE)
        found["gripper"].append([position, code, *arm.get_gripper_position()])

    found["position_mode"] = ready(arm, 0)
    before = arm.get_servo_angle()[1]
    found["long_move"] = arm.set_servo_angle(angle=FAR, speed=0.5, mvacc=10.0, wait=False)
    found["was_moving"] = wait_for(lambda: abs(arm.get_servo_angle()[1][0] - before[0]) > 0.05)
    arm.emergency_stop()
    stopped = arm.get_servo_angle()[1]
    time.sleep(0.2)
    found["stopped_state"] = arm.get_state()
    found["stopped_short"] = abs(stopped[0] - FAR[0]) > 0.3
    found["stayed_stopped"] = same(arm.get_servo_angle()[1], stopped, 1e-6)
    found["commands_left"] = arm.get_cmdnum()
    found["refused_after_stop"] = arm.set_servo_angle(angle=TARGET, wait=False)

    found["recovered"] = [arm.clean_error(), arm.clean_warn(), *ready(arm, 0)]
    found["home"] = arm.set_servo_angle(angle=TARGET, speed=2.0, mvacc=10.0, wait=True)
    found["home_angles"] = arm.get_servo_angle()
    found["codes"] = arm.get_err_warn_code()

    second = connect("real")
    found["realtime_report"] = wait_for(lambda: same(second.angles[:7], TARGET) and second.state == 2)
    found["realtime_position"] = second.position
    found["reports"] = {port: parsed(port) for port in [30000, 30001, 30002, 30003]}
    found["connected"] = [arm.connected, second.connected]
    arm.disconnect()
    second.disconnect()
    found["target"], found["stream_end"] = TARGET, STREAM[-1]
    return found


if __name__ == "__main__":
    # The SDK prints its log.
    with contextlib.redirect_stdout(sys.stderr):
        redirect([int(port) for port in sys.argv[1:]])
        found = run()
    print(json.dumps(found))
