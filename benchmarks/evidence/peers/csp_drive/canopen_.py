"""canopen's CiA 402 master against the emulated drive, over a virtual CAN bus: somebody else's table of its states."""

import logging
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from benchmarks.evidence.peers.csp_drive.drive import INTEGERS, OBJECTS, Drive, SdoError

NODE, CHANNEL = 1, "csp_drive"
TICKS, RUNS, WINDOW = 16, 500, 1000
"""Cycles of the drive between two looks at it, looks, and increments of the following error window."""


def enable_by_canopen() -> list[str]:
    """What its master says of the drive's states, a line each; one line where the package is not installed."""
    if find_spec("canopen") is None:
        return ["canopen is not installed, so its master did not enable the drive: skipped"]
    import canopen

    logging.getLogger("canopen.profiles").setLevel(logging.ERROR)  # else it says at each look that no PDO is mapped
    sides = [canopen.Network() for _ in range(2)]
    for side in sides:
        side.connect(interface="virtual", channel=CHANNEL)
    try:
        return list(_drive_states(*sides))
    finally:
        for side in sides:
            side.disconnect()


def _drive_states(ours: Any, theirs: Any) -> Iterator[str]:
    from canopen import LocalNode, SdoAbortedError, __version__
    from canopen.profiles.p402 import BaseNode402

    drive = Drive()

    def write(index: int, subindex: int, od: Any, data: bytes) -> None:
        try:
            drive.write(index, od.decode_raw(data), subindex)
        except SdoError as error:
            raise SdoAbortedError(error.code) from error

    node = LocalNode(NODE, make_dictionary())
    node.add_read_callback(lambda index, subindex, od: drive.read(index, subindex))
    node.add_write_callback(write)
    ours.add_node(node)
    master = BaseNode402(NODE, make_dictionary())
    theirs.add_node(master)
    master.setup_402_state_machine(False)

    yield f"canopen {__version__}'s CiA 402 master finds the drive in {master.state}"
    master.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    yield f"it sets its mode: {master.op_mode}"
    states = []
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
        master.state = state
        states.append(master.state)
    yield f"it enables it: {', '.join(states)}"
    master.sdo[0x6065].raw = WINDOW
    master.sdo[0x607A].raw = 100 * WINDOW
    states = list(_run(drive, master))
    master.reset_from_fault()
    yield f"a row {100 * WINDOW} increments away: {', '.join(states)}; after a reset {master.state}"
    master.state = "QUICK STOP ACTIVE"
    states = [master.state, *_run(drive, master)]
    yield f"a quick stop: {', '.join(states)}"
    codes = []
    for index, value in ((0x6041, 0), (0x6060, 1), (0x6099, 0)):
        try:
            master.sdo.download(index, 0, value.to_bytes(2 if index == 0x6041 else 1, "little"))
        except SdoAbortedError as error:
            codes.append(f"0x{index:04X} 0x{error.code:08X}")
    yield f"it is refused a write: {', '.join(codes)}"


def _run(drive: Drive, master: Any) -> Iterator[str]:
    """The states that the master sees while the drive runs, each once, until it stays in one."""
    before = master.state
    for _ in range(RUNS):
        drive.run(TICKS)
        if master.state != before:
            before = master.state
            yield before


def make_dictionary() -> Any:
    """The drive's objects in canopen's form."""
    from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes

    made = ObjectDictionary()
    for (index, subindex), (name, kind, access, _) in OBJECTS.items():
        signed, bits = INTEGERS[kind]
        variable = ODVariable(name, index, subindex)
        variable.data_type = getattr(datatypes, f"{'INTEGER' if signed else 'UNSIGNED'}{bits}")
        variable.access_type = access
        if subindex:
            if index not in made:
                made.add_object(ODRecord(name, index))
            made[index].add_member(variable)
        else:
            made.add_object(variable)
    return made
