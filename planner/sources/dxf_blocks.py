"""Blocks of DXF drawings: each INSERT expanded into the entities of its block, with the place of
every copy.

A copy maps a point p of the block to M p + t. M contains the scale factors, which may differ or
be negative, the rotation and the extrusion; t contains the insertion point and the block's base
point. A nested INSERT multiplies the maps. An array (MINSERT) adds its spacing, rotated but not
scaled, to the insertion point of every copy.

Layers follow the rules of the drawing program. An entity on layer 0 of a block lies on the layer
of the INSERT. A frozen layer hides an INSERT with all of its contents; a layer that is off hides
only the entities on it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import describe_value

MAX_COPIES = 1_000_000
"""Entities and copies of blocks in a drawing. More would not fit into a small memory."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Map of a block's coordinates to the drawing's: p ↦ linear @ p + shift, in its units."""

    linear: Array
    shift: Array

    def __matmul__(self, inner: "Placement") -> "Placement":
        """Return the map that applies `inner` first, then this one."""
        return Placement(self.linear @ inner.linear, self.linear @ inner.shift + self.shift)


@dataclass(frozen=True, slots=True)
class PlacedEntity:
    """An entity of the drawing, or one copy of an entity of a block.

    layer      name of the entity's layer
    parents    names of the layers of the INSERTs that contain it
    placement  map to the drawing's coordinates; None: the entity is not in a block
    visible    False if the entity or an INSERT that contains it is marked invisible
    fault      reason why an INSERT cannot be expanded, or ""
    """

    entity: Any
    layer: str
    parents: tuple[str, ...] = ()
    placement: Placement | None = None
    visible: bool = True
    fault: str = ""


def layer_of(entity: Any) -> str:
    """Return the name of an entity's layer, "0" if it states none; also for unknown kinds."""
    if entity.dxf.hasattr("layer"):
        return str(entity.dxf.layer)
    if hasattr(entity, "graphic_properties"):
        return str(entity.graphic_properties().get("layer", "0"))
    return "0"


def expand_blocks(entities: Iterable[Any]) -> list[PlacedEntity]:
    """List all entities in their order, each INSERT replaced by copies of its block's entities.

    Raises MotionError where there would be more than MAX_COPIES.
    """
    expanded: list[PlacedEntity] = []
    top = (
        PlacedEntity(entity, layer_of(entity), visible=_is_visible(entity)) for entity in entities
    )

    # a stack of iterators instead of recursion: blocks may be nested deeply
    stack: list[tuple[str, Iterator[PlacedEntity]]] = [("", top)]
    copies = 0
    while stack:
        placed = next(stack[-1][1], None)
        if placed is None:
            stack.pop()
            continue
        copies += 1
        if copies > MAX_COPIES:
            raise MotionError(
                f"its blocks make more than {MAX_COPIES} entities, the largest number that is read; "
                "shorten the arrays of blocks (INSERT), or split the drawing"
            )
        if placed.entity.dxftype() != "INSERT":
            expanded.append(placed)
            continue
        names = [name for name, _ in stack]
        fault = _find_fault(placed.entity, names)
        if fault:
            expanded.append(replace(placed, fault=fault))
            continue
        stack.append((placed.entity.dxf.name.lower(), _copy_block(placed)))
    return expanded


def _is_visible(entity: Any) -> bool:
    return not (entity.dxf.hasattr("invisible") and entity.dxf.invisible)


def _find_fault(insert: Any, open_blocks: list[str]) -> str:
    """Return why an INSERT cannot be expanded, or ""."""
    from ezdxf.xclip import XClip

    name = insert.dxf.get("name", "")
    block = insert.block()
    quoted = describe_value(name)
    if block is None:
        return f"the drawing has no block {quoted}; purge the INSERT, or define the block"
    if block.block.is_xref or block.block.is_xref_overlay:
        return (
            f"block {quoted} is in another drawing (an external reference); bind it into this one"
        )
    if name.lower() in open_blocks:
        return f"block {quoted} contains itself; take the inner INSERT out"
    if XClip(insert).is_clipping_enabled:
        return f"block {quoted} is clipped; explode and trim it, or take the clip off"
    return ""


def _copy_block(parent: PlacedEntity) -> Iterator[PlacedEntity]:
    """Yield the entities of an INSERT's block, for every cell of its array, then its attributes."""
    insert = parent.entity
    for placement in _cells(insert):
        whole = placement if parent.placement is None else parent.placement @ placement
        for entity in insert.block():
            yield _place(entity, parent, whole)
    for entity in insert.attribs:
        yield _place(entity, parent, parent.placement)


def _place(entity: Any, parent: PlacedEntity, placement: Placement | None) -> PlacedEntity:
    layer = layer_of(entity)
    layer = parent.layer if layer == "0" else layer
    parents = (*parent.parents, parent.layer)
    return PlacedEntity(entity, layer, parents, placement, parent.visible and _is_visible(entity))


def _cells(insert: Any) -> Iterator[Placement]:
    """Yield the map of each cell of an INSERT's array, row by row; one without an array."""
    matrix = np.array(list(insert.matrix44().rows()))  # ezdxf multiplies rows by it from the left
    linear, shift = matrix[:3, :3].T, matrix[3, :3]

    ocs = insert.ocs()
    angle = np.radians(insert.dxf.rotation)
    ux, uy = (np.array(list(ocs.to_wcs(axis))) for axis in ((1, 0, 0), (0, 1, 0)))
    across = np.cos(angle) * ux + np.sin(angle) * uy
    up = np.cos(angle) * uy - np.sin(angle) * ux

    column_spacing, row_spacing = insert.dxf.column_spacing, insert.dxf.row_spacing
    # without a spacing all copies would lie upon each other: one is read
    columns = max(1, insert.dxf.column_count) if column_spacing else 1
    rows = max(1, insert.dxf.row_count) if row_spacing else 1
    for row in range(rows):
        for column in range(columns):
            offset = column * column_spacing * across + row * row_spacing * up
            yield Placement(linear, shift + offset)
