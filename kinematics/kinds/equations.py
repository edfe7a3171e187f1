"""A machine that its file states by formulas of the inverse map; and that file's TOML.

Nothing of it is code.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, BeforeValidator

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import TableSchema
from kinematics.foundation.arrays import LEAST_POSITIVE, finite_array
from kinematics.foundation.errors import BadValue, MotionError, locate_errors, validation_error
from kinematics.foundation.formula import check_names, formula
from kinematics.foundation.names import closest, count_noun, nearest
from kinematics.foundation.units import Length, Unit, describe_value, quantity
from kinematics.kinds.axis_keys import (
    GEOMETRY,
    KIND,
    OWN_AXES,
    AxisTable,
    LinearAxis,
    LinearDefaults,
    RotaryAxis,
    axes,
    check_range,
)
from kinematics.kinds.load_keys import HOME, HomeTable, LoadedFile, home_entries
from kinematics.kinds.traverser import nearest_turn
from kinematics.machine.axis import Axis
from kinematics.machine.kind import Bar, Pivot, Skeleton, Sort, check_room
from kinematics.machine.load import Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import COMPONENTS, PoseLike, to_numbers

POSITIONS = ("x", "y", "z")
ROTATIONS = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
TRIED_TURN, SAME_COORDINATES = 0.01, 1e-9
"""rad by which home is turned to try formulas of the orientation, and by which coordinates may come
back other.
"""
COORDINATE = "q"
"""What formulas of bars call the coordinate of their axis."""
RESERVED = (*POSITIONS, *ROTATIONS, COORDINATE)


@dataclass(frozen=True, slots=True)
class BarFormulas:
    """A bar to draw for each axis: three formulas (m, base frame) of either end, which may contain
    q.
    """

    start: tuple[str, str, str]
    end: tuple[str, str, str]
    sort: Sort = "link"


@dataclass(frozen=True, slots=True)
class TurnFormula:
    """A turn about a coordinate axis, by a formula (rad) of the coordinates of the axes, by their
    names.
    """

    about: Literal["x", "y", "z"]
    angle: str


class Equations(Machine):
    """q_k = f_k(x, y, z, r11 … r33): a formula for each axis, of the pose in the base frame, in m
    and rad.

    moves         the components of the pose that it controls, as many as it has axes; the others
                  are held as at home
    follows       of rx, ry, rz, those that go along with them, as the spin of the tool of a
                  five-axis machine does
    room          (3, 2) m from which to which x, y and z may be, in the base frame; None: anywhere
    orientation   where some follow: the platform's orientation in the base frame, turn after turn
                  of moved axes
    coordinates   a formula for each axis, or one for all: see `kinematics.foundation.formula`
    constants     name -> a number (SI), or one number for each axis
    definitions   name -> a formula of the pose, of constants and of definitions before it
    bars          what is drawn
    length        m that count as one radian

    r11 … r33 are the rotation matrix of the platform, row and column. A rotary axis takes the turn
    of its angle that is nearest to where it stands. Raises MotionError, with what is allowed, for a
    formula that is none.
    """

    def __init__(
        self,
        moves: Sequence[str],
        coordinates: str | Sequence[str],
        *,
        axes: Iterable[Axis],
        home: PoseLike,
        follows: Sequence[str] = (),
        orientation: Sequence[TurnFormula] = (),
        room: Sequence[tuple[float, float]] | None = None,
        constants: Mapping[str, ArrayLike] | None = None,
        definitions: Mapping[str, str] | None = None,
        bars: Sequence[BarFormulas] = (),
        length: float = 0.1,
        name: str = "equations",
        load: Load | None = None,
    ) -> None:
        given = tuple(axes)
        for component in moves:
            if component not in COMPONENTS:
                told = f"machine {name}: moves {describe_value(component)}{nearest(component, COMPONENTS)}; components: "
                raise BadValue(
                    told + ", ".join(COMPONENTS),
                    key=("moves",),
                    nearest=closest(component, COMPONENTS),
                )
        if len(set(moves)) < len(moves):
            raise BadValue(
                f"machine {name}: moves {', '.join(moves)}: name each component once",
                key=("moves",),
            )
        self.freedom = tuple(component for component in COMPONENTS if component in moves)
        self.follows, self.orientation = tuple(follows), tuple(orientation)
        if twice := [component for component in follows if component in moves]:
            raise BadValue(
                f"machine {name}: {twice[0]} is among moves and follows: choose one",
                key=("follows",),
            )
        if bool(follows) != bool(orientation):
            told = "follows and orientation need each other: say what follows, and how the joints turn the platform"
            raise BadValue(
                f"machine {name}: {told}", key=("follows" if follows else "orientation",)
            )
        if room is not None:
            self.room = check_room(name, room)
        count = len(self.freedom)
        texts = (coordinates,) * count if isinstance(coordinates, str) else tuple(coordinates)
        if len(texts) != count or len(given) != count:
            raise BadValue(
                f"machine {name}: {count_noun(len(given), 'axis')} and "
                f"{count_noun(len(texts), 'formula')} for {count_noun(count, 'component')} "
                f"({', '.join(self.freedom)}); give as many of each",
                key=("coordinates",),
            )
        self.coordinates, self.bars = texts, tuple(bars)
        self.definitions = dict(definitions or {})
        self._constants = [
            self._constants_of(name, constants or {}, k, count) for k in range(count)
        ]
        self.sorts = tuple(axis.kind for axis in given)
        self.characteristic_length = float(
            finite_array(length, f"machine {name}: length", (), unit="m", least=LEAST_POSITIVE)
        )
        self.name, self.axes = name, given
        # Only a turn has several coordinates: a formula gives one of a linear axis.
        self.branched = any(axis.kind == "rotary" for axis in given)
        super().__init__(name, given, home, load=load)
        x = ca.SX.sym("x", 12)
        # whatever is wrong with a formula of a bar is told when the machine is made
        self.skeleton(x[:3], ca.reshape(x[3:], 3, 3), ca.SX.sym("q", count))
        if self.follows:
            self._check_orientation()

    def _check_orientation(self) -> None:
        """Raise MotionError where the orientation that is stated is of other coordinates than it
        was made from.
        """
        from scipy.spatial.transform import Rotation

        poses = to_numbers(self.home) + np.zeros((1 + 3, 1))
        turns = Rotation.from_rotvec(TRIED_TURN * np.eye(3)) * self.home.rotation
        poses[1:, 3:] = turns.as_matrix().reshape(3, 9)
        q = self.inverse_map(self.inputs(poses, self.home_q))
        again = self.inverse_map(self.inputs(self.carried_map(self.inputs(poses, q)), q))
        off = np.abs(again - q)
        if not off.max() < SAME_COORDINATES:
            k = int(np.nanargmax(off.max(0))) if np.isfinite(off).any() else 0
            told = "the orientation that is stated has other coordinates than those that it is worked out from"
            raise BadValue(
                f"machine {self.name}: axis {self.axes[k].name}: {told}", key=("orientation",)
            )

    def fill_pose(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        if not self.follows:
            return position, rotation
        known = {axis.name: q[k] for k, axis in enumerate(self.axes)}
        shared = {name: value for name, value in self.constants.items() if isinstance(value, float)}
        turned = ca.SX.eye(3)
        for turn in self.orientation:
            with locate_errors(f"machine {self.name}: orientation"):
                turned = turned @ _turn(turn.about, formula(turn.angle, shared, variables=known))
        return position, turned

    @property
    def constants(self) -> dict[str, float | tuple[float, ...]]:
        """Name -> a number (SI), or where they differ one for each axis."""
        found = {name: tuple(own[name] for own in self._constants) for name in self._constants[0]}
        return {name: row[0] if len(set(row)) == 1 else row for name, row in found.items()}

    @staticmethod
    def _constants_of(
        name: str, constants: Mapping[str, ArrayLike], k: int, count: int
    ) -> dict[str, float]:
        """Those of axis k."""
        found = {}
        for constant, value in constants.items():
            with locate_errors(f"machine {name}"):
                row = finite_array(
                    value, f"constant {constant} (one number, or one per axis)", (), (count,)
                )
            found[constant] = float(row if row.ndim == 0 else row[k])
        return found

    def _known(
        self, k: int, position: ca.SX, rotation: ca.SX, more: Mapping[str, ca.SX]
    ) -> dict[str, ca.SX]:
        """What formulas of axis k may name, with its definitions worked out in turn."""
        entries = (rotation[row, column] for row in range(3) for column in range(3))
        known = dict(
            zip((*POSITIONS, *ROTATIONS), (*(position[i] for i in range(3)), *entries), strict=True)
        )
        known |= more
        names = dict.fromkeys((*self._constants[k], *self.definitions), 0.0)
        check_names(names)
        for name in names:
            if name in RESERVED or (name in self.definitions and name in self._constants[k]):
                raise MotionError(
                    f"machine {self.name}: {name} has a meaning already; choose another name"
                )
        for name, text in self.definitions.items():
            known[name] = self._expression(k, f"definition {name}", text, known)
        return known

    def _expression(self, k: int, of: str, text: str, known: Mapping[str, ca.SX]) -> ca.SX:
        with locate_errors(f"machine {self.name}: axis {self.axes[k].name}: {of}"):
            return formula(text, self._constants[k], variables=known)

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        found = []
        for k, (axis, text) in enumerate(zip(self.axes, self.coordinates, strict=True)):
            value = self._expression(k, "coordinates", text, self._known(k, position, rotation, {}))
            if axis.kind == "rotary":
                # of atan2 itself, so that its arguments are enclosed once and not through sine and
                # cosine of an angle
                whole = value.is_op(ca.OP_ATAN2)
                sine, cosine = (
                    (value.dep(0), value.dep(1)) if whole else (ca.sin(value), ca.cos(value))
                )
                value = nearest_turn(sine, cosine, near[k])
            found.append(value)
        return ca.vertcat(*found)

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Each bar once for every axis, and a pivot where a link begins."""
        bars = []
        for k, axis in enumerate(self.axes):
            known = self._known(k, position, rotation, {COORDINATE: q[k]}) if self.bars else {}
            for bar in self.bars:
                start, end = (
                    ca.vertcat(*(self._expression(k, "bar", text, known) for text in texts))
                    for texts in (bar.start, bar.end)
                )
                bars.append(Bar(bar.sort, start, end, axis.name))
        return Skeleton(tuple(bars), tuple(Pivot(bar.start) for bar in bars if bar.sort == "link"))


def _turn(about: str, angle: ca.SX) -> ca.SX:
    """(3, 3) rotation about a coordinate axis."""
    first = POSITIONS.index(about)
    turned, (k, n) = ca.SX.eye(3), ((first + 1) % 3, (first + 2) % 3)
    turned[k, k] = turned[n, n] = ca.cos(angle)
    turned[n, k] = ca.sin(angle)
    turned[k, n] = -turned[n, k]
    return turned


def _read_constant(value: object) -> object:
    """Return a number in SI units, or of an array the tuple of its numbers."""
    if isinstance(value, (tuple, list)):
        return tuple(_read_number(entry) for entry in value)
    return _read_number(value)


def _read_number(value: object) -> float:
    """Return a plain number, a length or an angle in SI units."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    for unit in ("m", "rad"):
        try:
            return quantity(value, unit)
        except MotionError:
            continue
    remedy = 'write 2, "20 mm" or "30 deg"'
    raise validation_error(
        f"{describe_value(value)} is neither a number nor a length or an angle: {remedy}"
    )


Constant = Annotated[Any, BeforeValidator(_read_constant)]
Place = tuple[str, str, str]


class BarTable(TableSchema):
    """What is drawn of each axis."""

    start: Place = key(
        "start point: three formulas, which may contain q, the position of the axis",
        '["0", "0", "q"]',
    )
    end: Place = key("end point: three formulas, as start", '["x", "y", "z"]')
    sort: Literal["frame", "actuator", "link", "platform"] = key(
        "frame (fixed), actuator (changes its length), link (is moved) or platform (carries the tool)",
        '"link"',
        "link",
    )


class TurnTable(TableSchema):
    """A turn of the platform."""

    about: Literal["x", "y", "z"] = key("axis of the rotation: x, y or z", '"z"')
    angle: str = key("angle in rad: a formula, which may contain the names of joints", '"-c"')


Range = Annotated[tuple[Length, Length], AfterValidator(check_range)]


class RoomTable(TableSchema):
    """A box in the base frame that the platform's origin stays in; no bound where none is
    stated.
    """

    x: Range | None = key("lowest and highest x", '["0 mm", "220 mm"]', None)
    y: Range | None = key("lowest and highest y", '["0 mm", "220 mm"]', None)
    z: Range | None = key("lowest and highest z", '["0 mm", "250 mm"]', None)


class EquationsGeometry(TableSchema):
    """How the machine moves: formulas of its inverse map, in m and rad."""

    moves: tuple[str, ...] = key(
        "degrees of freedom that the axes control, of x y z rx ry rz", '["x", "y", "z"]'
    )
    joints: tuple[str, ...] = key("names of the axes", '["a", "b", "c"]')
    rotary: tuple[str, ...] = key("names of the rotary axes", '["c"]', ())
    follows: tuple[Literal["rx", "ry", "rz"], ...] = key(
        "dependent degrees of freedom, such as the spin of a five-axis machine's tool", '["rz"]', ()
    )
    orientation: tuple[TurnTable, ...] = key(
        "with follows: orientation of the platform, as rotations about the moving axes in turn",
        '[{ about = "z", angle = "-c" }, { about = "x", angle = "-a" }]',
        (),
    )
    coordinates: Annotated[
        Any, Chosen(lambda value: str if isinstance(value, str) else tuple[str, ...])
    ] = key(
        "position of each axis: a formula of x, y, z (m) and r11 … r33; or one formula for all",
        '["x + y", "x - y", "z"]',
    )
    constants: dict[str, Constant] = key(
        "named numbers, lengths or angles; one value, or one for each axis",
        '{ rod = "250 mm" }',
        {},
    )
    definitions: dict[str, str] = key(
        "named formulas; each may contain those before it", '{ reach = "x**2 + y**2" }', {}
    )
    bar: tuple[BarTable, ...] = key(
        "bars that pictures of the machine show for each axis",
        '[{ start = ["0", "0", "q"], end = ["x", "y", "z"] }]',
        (),
    )
    length: Annotated[float, Unit("m", above=0)] = key(
        "lever arm that makes a rotation comparable to a length", '"100 mm"', 0.1
    )
    room: RoomTable | None = key(
        "range of x, y and z, in addition to the travel of the axes",
        '{ z = ["-400 mm", "400 mm"] }',
        None,
    )
    home: HomeTable = HOME


class OwnLinear(LinearAxis):
    name: str


class OwnTurning(RotaryAxis):
    name: str


def _pick_axis_table(value: Any) -> type[TableSchema]:
    """By its units: what turns states angles.

    What its own name says, the machine's tables cannot know.
    """
    texts = str(value.values()) if isinstance(value, dict) else ""
    return OwnTurning if any(unit in texts for unit in ("deg", "rad", "rev", "turn")) else OwnLinear


class EquationsFile(LoadedFile):
    """A machine of formulas, key by key."""

    kind: Literal["equations"] = KIND
    geometry: EquationsGeometry = GEOMETRY
    axes: LinearDefaults | None = key("values that all linear axes share", default=None)
    rotary: RotaryAxis | None = key("values that all rotary axes share", default=None)
    axis: tuple[Annotated[Any, Chosen(_pick_axis_table)], ...] = OWN_AXES

    def list_freedom(self) -> tuple[str, ...]:
        return tuple(component for component in COMPONENTS if component in self.geometry.moves)

    def list_axes(self) -> list[Axis]:
        """List the axes.

        Raises BadValue for an unknown axis, and for a missing table or one of the wrong sort.
        """
        joints, rotary = self.geometry.joints, self.geometry.rotary
        for name in (*rotary, *(entry.name for entry in self.axis)):
            if name not in joints:
                known = ", ".join(joints)
                message = f"{describe_value(name)} is no axis{nearest(name, joints)}; axes: {known}"
                raise BadValue(
                    message, key=("joints",), allowed=known, nearest=closest(name, joints)
                )
        for entry in self.axis:
            turns = entry.name in rotary
            if turns != isinstance(
                entry, OwnTurning
            ):  # its numbers are read in the units of the other sort
                sort = (
                    'turns: state angles, as "90 deg/s"'
                    if turns
                    else 'slides: state lengths, as "20 mm/s"'
                )
                raise BadValue(f"axis {entry.name} {sort}", key=(entry.name, "name"))
        tables: dict[str, AxisTable] = {}
        for name in joints:
            table = self.rotary if name in rotary else self.axes
            if table is None:
                missing = "rotary" if name in rotary else "axes"
                raise BadValue(f"axis {name} needs the table [{missing}]: add it", key=("joints",))
            tables[name] = table
        return axes(joints, tables, self.axis, self)

    @staticmethod
    def geometry_of(machine: Equations, complete: bool) -> dict[str, Any]:
        """Constants are written in SI units, whatever they were read in."""
        texts = machine.coordinates
        rotary = tuple(axis.name for axis in machine.axes if axis.kind == "rotary")
        room = {
            name: row
            for name, row in zip(POSITIONS, machine.room, strict=True)
            if np.isfinite(row).all()
        }
        bars = tuple({"start": bar.start, "end": bar.end, "sort": bar.sort} for bar in machine.bars)
        return {
            "moves": machine.freedom,
            "joints": tuple(axis.name for axis in machine.axes),
            "rotary": rotary or None,
            "follows": machine.follows or None,
            "orientation": tuple(
                {"about": one.about, "angle": one.angle} for one in machine.orientation
            )
            or None,
            "coordinates": texts[0] if len(set(texts)) == 1 else texts,
            "constants": machine.constants or None,
            "definitions": machine.definitions or None,
            "bar": bars or None,
            "length": machine.characteristic_length,
            "room": room or None,
            "home": home_entries(machine),
        }


def build_equations(file: EquationsFile, name: str, folder: Path | Traversable) -> Equations:
    geometry, box = file.geometry, file.geometry.room
    return Equations(
        geometry.moves,
        geometry.coordinates,
        axes=file.list_axes(),
        home=geometry.home.numbers,
        follows=geometry.follows,
        orientation=[TurnFormula(turn.about, turn.angle) for turn in geometry.orientation],
        room=None if box is None else tuple(way or (-inf, inf) for way in (box.x, box.y, box.z)),
        constants={constant: np.asarray(value) for constant, value in geometry.constants.items()},
        definitions=geometry.definitions,
        bars=[BarFormulas(bar.start, bar.end, bar.sort) for bar in geometry.bar],
        length=geometry.length,
        name=name,
        load=file.load(),
    )
