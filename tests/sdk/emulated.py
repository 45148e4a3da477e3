"""The vendor's SDK against an emulator on free ports.

The SDK has the ports of a controller built in. Its connections to 127.0.0.1 go to the emulator's ports instead; the package itself
is as it was installed, and no other address is let through.
"""

import socket

HOST = "127.0.0.1"


def redirect(ports):
    """From now on the SDK's connections go to `ports`: commands, stop, fast, normal, rich, real-time."""
    emulated = dict(zip([502, 503, 30000, 30001, 30002, 30003], ports))
    plain = socket.socket.connect

    def connect(self, address):
        if self.family == socket.AF_INET:
            host, port = address
            assert host == HOST and port in emulated, f"a connection to {address}"
            address = (HOST, emulated[port])
        return plain(self, address)

    socket.socket.connect = connect


def arm(report_type):
    """The SDK's client, after `redirect`."""
    from xarm.wrapper import XArmAPI

    # A Unix socket of another emulator in /tmp would be preferred.
    return XArmAPI(HOST, is_radian=True, report_type=report_type, forbid_uds=True)
