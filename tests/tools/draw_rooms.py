"""The packages and their folders as a picture and a table, made from the imports of the code.

``python tests/tools/draw_rooms.py`` writes docs/pictures/rooms.svg and the table in docs/architecture.md between
the two marks; ``tests/docs/test_architecture.py`` checks that both are up to date.
"""

import ast
import html
from dataclasses import dataclass, field
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "pictures" / "rooms.svg"
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- rooms: begin -->", "<!-- rooms: end -->"
PACKAGES = ("companion", "landing", "drivers")
COLOURS = {"companion": "#e8eef7", "landing": "#e9f5e6", "drivers": "#f8efe1"}

BOX_HEIGHT, ROW_HEIGHT, GAP, MARGIN, LETTER = 27, 58, 14, 20, 7.6
HEAD = 30


@dataclass
class Room:
    """A folder below a package, or a module directly in it: ``landing.plane``, ``landing.options``."""

    name: str
    imports: set[str] = field(default_factory=set)

    @property
    def package(self) -> str:
        """The package that it belongs to."""
        return self.name.partition(".")[0]

    @property
    def label(self) -> str:
        """What stands in its box: ``plane/`` for a folder, ``options.py`` for a module."""
        return self.name.partition(".")[2] + ("/" if self.is_folder else ".py")

    @property
    def is_folder(self) -> bool:
        """Whether it is a folder of modules."""
        return (ROOT / Path(*self.name.split("."))).is_dir()

    @property
    def purpose(self) -> str:
        """The first sentence of its docstring."""
        path = ROOT / Path(*self.name.split("."))
        file = path / "__init__.py" if self.is_folder else path.with_suffix(".py")
        text = ast.get_docstring(ast.parse(file.read_text())) or ""
        return " ".join(text.split("\n\n")[0].split())


def room_of(module: str, depth: int = 2) -> str:
    """The room of a module by its dotted name."""
    return ".".join(module.split(".")[:depth])


def rooms() -> dict[str, Room]:
    """Every room by name, with the rooms that its modules import when they run."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None, exclude_type_checking_imports=True)
    found: dict[str, Room] = {}
    for module in sorted(graph.modules):
        if "." not in module:
            continue
        room = found.setdefault(room_of(module), Room(room_of(module)))
        room.imports |= {room_of(other) for other in graph.find_modules_directly_imported_by(module)}
    for room in found.values():
        room.imports = {name for name in room.imports if name != room.name and name in found}
    return found


def cycle(imports: dict[str, set[str]]) -> list[str]:
    """Nodes on or behind a cycle, empty without one."""
    left = dict(imports)
    while free := [name for name, others in left.items() if not others & left.keys()]:
        for name in free:
            del left[name]
    return sorted(left)


def reduced(imports: dict[str, set[str]]) -> dict[str, set[str]]:
    """The imports without those that another path implies (transitive reduction of a graph without cycles)."""
    reach: dict[str, set[str]] = {}

    def behind(name: str) -> set[str]:
        if name not in reach:
            reach[name] = set(imports[name]).union(*(behind(other) for other in imports[name]))
        return reach[name]

    return {
        name: {other for other in others if not any(other in behind(via) for via in others - {other})}
        for name, others in imports.items()
    }


def layers(imports: dict[str, set[str]]) -> list[list[str]]:
    """Rows of names: a name stands in the row below the last that imports it."""
    depth: dict[str, int] = {}

    def of(name: str) -> int:
        if name not in depth:
            depth[name] = 1 + max((of(user) for user in imports if name in imports[user]), default=-1)
        return depth[name]

    rows: list[list[str]] = [[] for _ in range(1 + max(map(of, imports)))]
    for name in sorted(imports):
        rows[depth[name]].append(name)
    return rows


def box_width(room: Room) -> float:
    """Width of a room's box."""
    return 16 + LETTER * len(room.label)


def package_picture(
    package: str, everything: dict[str, Room], x: float, y: float
) -> tuple[str, float, float]:
    """One package's frame, arrows and boxes at (x, y); the SVG text, its width and height."""
    inside = {name: room for name, room in everything.items() if room.package == package}
    imports = {name: {o for o in room.imports if o in inside} for name, room in inside.items()}
    rows = layers(imports)
    widths = [sum(box_width(inside[n]) for n in row) + GAP * (len(row) - 1) for row in rows]
    width = max(widths) + 2 * MARGIN
    height = HEAD + ROW_HEIGHT * len(rows)
    place: dict[str, tuple[float, float, float]] = {}
    for k, row in enumerate(rows):
        left = x + (width - widths[k]) / 2
        for name in row:
            place[name] = left, y + HEAD + 10 + k * ROW_HEIGHT, box_width(inside[name])
            left += box_width(inside[name]) + GAP
    parts = [
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}" rx="8" '
        f'fill="{COLOURS[package]}" stroke="#889"/>',
        f'<text x="{x + 12:.0f}" y="{y + 22:.0f}" class="package">{package}/</text>',
    ]
    for name, others in sorted(reduced(imports).items()):
        left, top, wide = place[name]
        start = left + wide / 2, top + BOX_HEIGHT
        for other in sorted(others):
            to = place[other][0] + place[other][2] / 2, place[other][1] - 3
            bend = ROW_HEIGHT / 2
            parts.append(
                f'<path d="M{start[0]:.0f},{start[1]:.0f} C{start[0]:.0f},{start[1] + bend:.0f} '
                f'{to[0]:.0f},{to[1] - bend:.0f} {to[0]:.0f},{to[1]:.0f}" class="arrow"/>'
            )
    for name, (left, top, wide) in place.items():
        middle = left + wide / 2
        parts += [
            f'<rect x="{left:.0f}" y="{top:.0f}" width="{wide:.0f}" height="{BOX_HEIGHT}" rx="5" class="box"/>',
            f'<text x="{middle:.0f}" y="{top + 18:.0f}" class="name">{html.escape(inside[name].label)}</text>',
        ]
    return "\n".join(parts), width, height


def picture(everything: dict[str, Room]) -> str:
    """The whole picture as SVG: companion above, landing and drivers below it."""
    top, wide, high = package_picture("companion", everything, MARGIN, MARGIN)
    below = 2 * MARGIN + high
    left, left_wide, left_high = package_picture("landing", everything, MARGIN, below)
    right, right_wide, right_high = package_picture("drivers", everything, 2 * MARGIN + left_wide, below)
    width = 2 * MARGIN + max(wide, left_wide + MARGIN + right_wide)
    height = below + max(left_high, right_high) + MARGIN
    return "\n".join(
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">',
            "<style>.package{font-size:16px;font-weight:bold}.name{font-size:13px;text-anchor:middle}"
            ".box{fill:#fff;stroke:#667}"
            ".arrow{fill:none;stroke:#99a;marker-end:url(#head)}</style>",
            '<marker id="head" markerWidth="7" markerHeight="7" refX="5" refY="3" orient="auto">'
            '<path d="M0,0 L6,3 L0,6 z" fill="#99a"/></marker>',
            f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
            top,
            left,
            right,
            "</svg>\n",
        )
    )


def table(everything: dict[str, Room]) -> str:
    """Every folder with its purpose and the folders that it imports, in Markdown."""
    lines = ["| folder | purpose | imports |", "|---|---|---|"]
    for package in PACKAGES:
        for name in sorted(everything):
            room = everything[name]
            if room.package == package and room.is_folder:
                lines.append(f"| `{name.replace('.', '/')}/` | {room.purpose} | {_names(room)} |")
    return "\n".join(lines)


def _names(room: Room) -> str:
    own = {other.partition(".")[2] for other in room.imports if other.startswith(room.package + ".")}
    packages = {other.partition(".")[0] + "/" for other in room.imports} - {room.package + "/"}
    return ", ".join(f"`{name}`" for name in (*sorted(own), *sorted(packages)))


def page_with(text: str, new: str) -> str:
    """The page with its table between the marks replaced."""
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n{new}\n{END}{rest.partition(END)[2]}"


def main() -> None:
    """Write the picture and the table."""
    everything = rooms()
    PICTURE.write_text(picture(everything))
    PAGE.write_text(page_with(PAGE.read_text(), table(everything)))


if __name__ == "__main__":
    main()
