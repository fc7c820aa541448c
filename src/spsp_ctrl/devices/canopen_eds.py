"""Electronic data sheet (CiA 306) of a node, from its object dictionary: what a configuration tool loads."""

from __future__ import annotations

from collections.abc import Iterator

from spsp_ctrl.devices.canopen_device import Key, Object

_TYPES = {(8, False): 0x05, (16, False): 0x06, (32, False): 0x07, (8, True): 0x02, (16, True): 0x03, (32, True): 0x04, (0, False): 0x09}
_MANDATORY = (0x1000, 0x1001, 0x1018)


_PDO_SETTINGS = ((0x1400, 0x1600), (0x1800, 0x1A00))


def eds(name: str, objects: dict[Key, Object], node: int = 0) -> str:
    """Text of the file. The default values are those of the dictionary.

    ``node`` is the number whose dictionary this is: identifiers of PDOs are then written relative to it (``$NODEID+0x180``), so that the
    file serves every number. Without it they are those of the dictionary.
    """
    numbers = sorted({index for index, _ in objects})
    groups = {
        "MandatoryObjects": [n for n in numbers if n in _MANDATORY],
        "OptionalObjects": [n for n in numbers if n not in _MANDATORY and not 0x2000 <= n < 0x6000],
        "ManufacturerObjects": [n for n in numbers if 0x2000 <= n < 0x6000],
    }
    lines = ["[FileInfo]", f"FileName={name}.eds", "FileVersion=1", "FileRevision=1", "EDSVersion=4.0", f"Description={name}", ""]
    lines += ["[DeviceInfo]", "VendorName=spsp-ctrl", f"ProductName={name}", "BaudRate_1000=1", "SimpleBootUpSlave=1", ""]
    lines += ["[DummyUsage]", *(f"Dummy{n:04X}=0" for n in range(1, 8)), ""]
    for group, members in groups.items():
        lines += [f"[{group}]", f"SupportedObjects={len(members)}", *(f"{i}=0x{n:04X}" for i, n in enumerate(members, 1)), ""]
    for number in numbers:
        relative = node if any(low <= number < high for low, high in _PDO_SETTINGS) else 0
        lines += [*_entry(number, {sub: o for (index, sub), o in objects.items() if index == number}, relative), ""]
    return "\n".join(lines)


def _entry(number: int, parts: dict[int, Object], node: int) -> Iterator[str]:
    yield f"[{number:04X}]"
    if list(parts) == [0]:
        yield from _variable(parts[0])
        return
    yield f"ParameterName={next(iter(parts.values())).name.removesuffix(' count')}"
    yield "ObjectType=0x9"
    yield f"SubNumber={len(parts)}"
    for sub, part in sorted(parts.items()):
        yield ""
        yield f"[{number:04X}sub{sub:X}]"
        yield from _variable(part, node if sub == 1 else 0)


def _variable(part: Object, node: int = 0) -> Iterator[str]:
    yield f"ParameterName={part.name}"
    yield "ObjectType=0x7"
    yield f"DataType=0x{_TYPES[part.bits, part.signed]:04X}"
    yield f"AccessType={'rw' if part.writable else 'ro'}"
    value = f"$NODEID+0x{part.value - node:X}" if node else part.text if not part.bits else part.value
    yield f"DefaultValue={value}"
    yield f"PDOMapping={int(part.mappable)}"
