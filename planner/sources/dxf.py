"""DXF drawings, by ezdxf (extra `cad`): lines, arcs, circles, polylines, ellipses, splines of model space.

| entity | becomes |
|---|---|
| LINE, ARC, CIRCLE | lines and arcs, exactly, in whatever plane |
| LWPOLYLINE, POLYLINE | lines, and of bulges arcs, exactly; of a smoothed one what the smoothing made of it |
| ELLIPSE | a spline through points, within the option `deviation`; an arc where its axes are alike |
| SPLINE | the same, in parts where it has corners; lines where its degree is 1 |

Everything else is a fault, told by its handle, layer and kind: leave its layer out, or change the drawing. Entities
whose ends are within `tolerance` become one contour, turned round where they have to be. What lies between the ends is
closed by leading the next one from where the path stands. Widths and thicknesses are not looked at. Coordinates stay
the drawing's: the option `origin` makes the program's work frame, in which its plane lies anywhere.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.errors import MotionError
from planner.program import Blend, Line, Program, Stop, Through
from planner.sources.chains import chained
from planner.sources.cutting import Cutting, program_of
from planner.sources.dxf_file import HANDLE, drawing, refuse_unknown
from planner.sources.dxf_lines import line_of
from planner.sources.dxf_shapes import Shapes
from planner.sources.faults import Faults
from planner.sources.placed import placed
from planner.sources.source import Imported, option
from planner.sources.stroke import Chain
from planner.wanted import positive


@dataclass(frozen=True, slots=True)
class Dxf:
    """DXF drawings: lines, arcs, circles, polylines, ellipses, splines; anything else is refused by its handle."""

    suffixes: ClassVar[tuple[str, ...]] = (".dxf",)
    length: str | None = option(None, 'unit of the drawing, as "mm". Default: what it states itself')
    layers: str | None = option(None, 'only these layers, as "CUT, MARK". Default: all that are not off or frozen')
    skip: str | None = option(None, 'layers to leave out, as "NOTES, 0"')
    tolerance: float = option(1e-5, "ends so near each other are one. Default 0.01 mm", "m")
    deviation: float = option(1e-6, "by how much curves may leave ellipses and splines. Default 0.001 mm", "m")
    order: Literal["nearest", "file"] = option(
        "nearest", "of contours: nearest shortens the way between them, file leaves it. Default nearest"
    )
    join: Literal["through", "stop"] = option(
        "through", "inside contours: through passes where smooth, stop rests. Default through"
    )
    blend: float | None = option(None, 'instead: round joins within so much, as "0.05 mm"', "m")
    speed: float | None = option(None, "cap of the tool's speed along contours. Default: none", "m/s")
    rapid: float | None = option(None, "cap of the tool's speed between contours. Default: none", "m/s")
    retract: float | None = option(
        None, "height above the drawing's plane of the way between contours. Default: in the plane", "m"
    )
    approach: float = option(0.0, "height above a contour's start from which it goes down at speed. Default 0", "m")
    lead_in: float | None = option(None, "length of a tangential way into closed contours. Default: none", "m")
    lead: Literal["line", "arc"] = option("line", "its shape: straight, or a quarter circle. Default line")
    side: Literal["outside", "inside"] = option("outside", "where a quarter circle comes from. Default outside")
    origin: str | None = option(
        None, 'where the drawing\'s zero lies from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home'
    )

    def __post_init__(self) -> None:
        units = {"blend": "m", "speed": "m/s", "rapid": "m/s", "lead_in": "m", "tolerance": "m", "deviation": "m"}
        for name, unit in units.items():
            positive("dxf", name, getattr(self, name), unit)
        if not (np.isfinite(self.approach) and self.approach >= 0 and np.isfinite(self.retract or 0)):
            raise MotionError("dxf: retract and approach must be finite, and approach not negative")
        if self.approach and self.retract is None:
            raise MotionError("dxf: approach needs retract, the height that it starts from")

    @property
    def named(self) -> list[str]:
        return _names(self.layers)

    @property
    def skipped(self) -> list[str]:
        return _names(self.skip)

    def read(self, path: Path) -> Imported:
        """The program of a DXF file. Raises FileError with its faults; MotionError where ezdxf is not installed."""
        faults = Faults(str(path))
        found = drawing(path, self)
        shapes = Shapes(found.metres, self.deviation)
        refuse_unknown(path, [entity for entity in found.entities if not shapes.knows(entity)], faults)
        parts: list[Chain] = []
        for entity in found.entities:
            if shapes.knows(entity):
                try:
                    parts += shapes.strokes(entity)
                except MotionError as wrong:
                    named = f"{entity.dxftype()} {entity.dxf.handle}"
                    faults.add(str(wrong), line_of(path, HANDLE, str(entity.dxf.handle)), named)
                except Exception as wrong:  # what ezdxf comes upon in an entity that it has read
                    named = f"{entity.dxftype()} {entity.dxf.handle}"
                    faults.add(f"broken: {wrong}", line_of(path, HANDLE, str(entity.dxf.handle)), named)
        kept, short = _long_enough(parts, self.tolerance)
        if not faults and not kept:
            faults.add("nothing to run: it has no lines and no curves on these layers, none longer than the tolerance")
        faults.refuse()
        chains, forks = chained(kept, self.tolerance)
        closed = [bool(np.linalg.norm(chain[0].start - chain[-1].end) <= self.tolerance) for chain in chains]
        work = None if self.origin is None else placed(self.origin)
        start = np.zeros(3) if work is None else work.inv().translation
        segments = program_of(chains, closed, self._cutting(), np.asarray(start))
        program = Program(segments, "home", name=path.stem, work=work)
        told = [*found.warnings, *self._warnings(shapes, short, forks, len(chains))]
        entities = dict(sorted(Counter(entity.dxftype() for entity in found.entities).items()))
        return Imported(program, entities, tuple(told))

    def _cutting(self) -> Cutting:
        join = Blend(self.blend) if self.blend is not None else Stop() if self.join == "stop" else Through()
        return Cutting(
            join, self.rapid, self.speed, self.retract, self.approach, self.lead_in, self.lead, self.side,
            self.order == "nearest",
        )  # fmt: skip

    def _warnings(self, shapes: Shapes, short: int, forks: int, contours: int) -> list[str]:
        told = []
        if shapes.worst:
            told.append(f"ellipses and splines are curves through points, off by {shapes.worst * 1e6:.3g} um at most")
        if shapes.nothing:
            told.append(f"{shapes.nothing} lines, arcs and sides have no length, and were left out")
        if short:
            told.append(f"{short} entities are shorter than the tolerance, and were left out")
        if shapes.flattened:
            told.append(f"{shapes.flattened} entities have a width or a thickness: what is run is their middle")
        if forks:
            told.append(f"{forks} places have more than two ends: contours go on there where they bend least")
        if contours > 1 and self.retract is None:
            told.append(f"{contours} contours, and no retract: the way between them lies in the drawing's plane")
        return told


def _names(text: str | None) -> list[str]:
    return [name.strip().lower() for name in (text or "").split(",") if name.strip()]


def _long_enough(parts: list[Chain], tolerance: float) -> tuple[list[Chain], int]:
    """Without lines that are all within the tolerance, which their own two ends would close; and how many they are."""
    kept = [
        chain
        for chain in parts
        if len(chain) > 1
        or not isinstance(chain[0].segment, Line)
        or np.linalg.norm(chain[0].end - chain[0].start) > tolerance
    ]
    return kept, len(parts) - len(kept)
