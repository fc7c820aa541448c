"""From the words of a rig file to an open bus or line. The lock-step ones are made by who owns their other end."""

from __future__ import annotations

from collections.abc import Mapping

from spsp_ctrl.devices.transport.base import CanTransport, SerialTransport, TransportError

Option = str | int | float | bool


def open_can(interface: str, channel: str, bitrate: int, options: Mapping[str, Option] | None = None) -> CanTransport:
    """A CAN bus by the name of its python-can interface; ``slcan`` is ours, with the options ``baud`` and ``answers``. Raises ``TransportError``."""
    if interface == "slcan":
        from spsp_ctrl.devices.transport.slcan import SlcanBus

        given = dict(options or {})
        port, _, speed = channel.partition("@")  # python-can's way to write the speed of the port
        baud, answers = given.pop("baud", given.pop("tty_baudrate", speed or 115_200)), given.pop("answers", True)
        if given:
            raise TransportError(f"slcan {channel}: unknown option {next(iter(given))!r}; there are baud and answers")
        try:
            return SlcanBus(port, bitrate, int(baud), answers=bool(answers))
        except ValueError:
            raise TransportError(f"slcan {channel}: {baud!r} is no baud rate") from None
    from spsp_ctrl.devices.transport.python_can import PythonCanBus

    return PythonCanBus(interface, channel, bitrate, options)


def open_serial(port: str, baud: int) -> SerialTransport:
    """A serial line by the path of its port. Raises ``TransportError``."""
    from spsp_ctrl.devices.transport.serial_line import SerialLine

    return SerialLine(port, baud)
