"""Watches an emulated xArm7 with the vendor's SDK while someone else moves it, and prints the joint angles it saw as JSON.

Usage: observe.py COMMAND STOP FAST NORMAL RICH REALTIME, the emulator's ports. It prints a line when it has begun, and ends when its
standard input is closed.
"""

import contextlib
import json
import sys
import threading
import time

from emulated import arm as connect, redirect


def run(begun):
    arm = connect("real")
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    asked, reported, states = [], [], set()
    begun()
    while not over.is_set():
        code, angles = arm.get_servo_angle()
        if code == 0:
            asked.append(angles)
        reported.append(arm.angles[:7])
        states.add(arm.state)
        time.sleep(0.004)
    found = {"asked": asked, "reported": reported, "states": sorted(states), "final": arm.get_servo_angle()}
    found["mode"], found["codes"] = arm.mode, arm.get_err_warn_code()
    arm.disconnect()
    return found


if __name__ == "__main__":
    plain = sys.stdout
    # The SDK prints its log.
    with contextlib.redirect_stdout(sys.stderr):
        redirect([int(port) for port in sys.argv[1:]])
        found = run(lambda: print("begun", file=plain, flush=True))
    print(json.dumps(found))
