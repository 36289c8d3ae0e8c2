"""Measures how time and memory grow with triangles, probes, sources and the error asked for, and draws docs/scaling.svg.

    cargo build --release
    python3 docs/scaling.py target/release/diffray docs/scaling.svg

The room is a box of 10 x 6 x 3 m whose faces are grids of triangles with bumps of up to 0.1 m. Times are processor seconds of
whole runs, memory is the most that was resident.
"""

import math
import multiprocessing
import os
import sys
import tempfile

SIZE = (10.0, 6.0, 3.0)
ROOM = """name = "bumpy"
[material.even]
absorption = 0.2
scattering = 0.1
[[mesh]]
file = "mesh.obj"
material = "even"
[simulation]
target_db = {target_db}
max_time_s = 300.0
"""


def scramble(i):
    """A number in 0..1 that follows no visible order."""
    mask = (1 << 64) - 1
    z = (i + 1) * 0x9E3779B97F4A7C15 & mask
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & mask
    z = (z ^ z >> 27) * 0x94D049BB133111EB & mask
    return (z ^ z >> 31) / 2.0**64


def write_mesh(path, triangles):
    """Writes about as many triangles; gives how many. In a process of its own, as a child starts with its parent's memory."""
    n = max(1, round(math.sqrt(triangles / 12)))
    writer = multiprocessing.Process(target=write_grids, args=(path, n))
    writer.start()
    writer.join()
    return 12 * n * n


def write_grids(path, n):
    """Writes six faces of n x n squares, two triangles each."""
    ids, corners, faces = {}, [], []

    def corner(axis, side, i, j):
        p = [0.0, 0.0, 0.0]
        u, v = (axis + 1) % 3, (axis + 2) % 3
        p[u], p[v] = SIZE[u] * i / n, SIZE[v] * j / n
        bump = 0.1 * scramble((i * 4096 + j) * 6 + axis * 2 + side) if 0 < i < n and 0 < j < n else 0.0
        p[axis] = bump if side == 0 else SIZE[axis] - bump
        key = tuple(round(c, 9) for c in p)
        if key not in ids:
            ids[key] = len(ids) + 1
            corners.append(p)
        return ids[key]

    for axis in range(3):
        for side in range(2):
            for i in range(n):
                for j in range(n):
                    a, b, c, d = (corner(axis, side, *at) for at in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
                    faces += [(a, b, c), (a, c, d)]
    with open(path, "w", encoding="ascii") as file:
        file.writelines("v %.9f %.9f %.9f\n" % tuple(p) for p in corners)
        file.writelines("f %d %d %d\n" % f for f in faces)


def run(program, folder, probes=1, sources=1, target_db=0.5):
    """Processor seconds and memory in MB of one run."""
    room = ROOM.format(target_db=target_db)
    for i in range(sources):
        room += f'[[source]]\nname = "source {i}"\nposition_m = [{2.0 + 0.3 * i}, {2.5 - 0.2 * (i % 3)}, 1.5]\n'
    for i in range(probes):
        room += f'[[probe]]\nname = "probe {i}"\nposition_m = [{6.3 + 0.3 * (i % 8)}, {1.0 + 0.5 * (i // 8)}, 1.2]\n'
    path = os.path.join(folder, "room.toml")
    with open(path, "w", encoding="ascii") as file:
        file.write(room)
    with open(os.devnull, "w") as silence:
        arguments = [program, "simulate", path, "--out", os.path.join(folder, "out")]
        actions = [(os.POSIX_SPAWN_DUP2, silence.fileno(), 1), (os.POSIX_SPAWN_DUP2, silence.fileno(), 2)]
        child = os.posix_spawn(program, arguments, os.environ, file_actions=actions)
        _, status, used = os.wait4(child, 0)
    if status != 0:
        sys.exit(f"{' '.join(arguments)}: status {status}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def measure(program):
    """Panels: (title, label of x, [(x, seconds, MB)])."""
    panels = []
    with tempfile.TemporaryDirectory() as folder:
        mesh = os.path.join(folder, "mesh.obj")
        rows = []
        for triangles in (12, 500, 5_000, 50_000, 500_000):
            count = write_mesh(mesh, triangles)
            rows.append((count, *run(program, folder)))
        panels.append(("triangles", "one source, one probe, 0.5 dB", rows))
        write_mesh(mesh, 5_000)
        probes = [(n, *run(program, folder, probes=n)) for n in (1, 4, 16, 64)]
        panels.append(("probes", "4800 triangles, one source, 0.5 dB", probes))
        sources = [(n, *run(program, folder, sources=n)) for n in (1, 2, 4, 8)]
        panels.append(("sources", "4800 triangles, one probe, 0.5 dB", sources))
        targets = [(t, *run(program, folder, target_db=t)) for t in (0.1, 0.05, 0.02, 0.01)]
        panels.append(("target_db", "4800 triangles, one source, one probe", targets))
    return panels


STYLE = """<style>
  svg { --paper: #fff; --ink: #1c2330; --muted: #5b6676; --rule: #dde1e8; --time: #1f6fb5; --memory: #e8590c; }
  @media (prefers-color-scheme: dark) {
    svg { --paper: #14181f; --ink: #e4e8ef; --muted: #98a4b5; --rule: #323b49; --time: #6cb2f2; --memory: #ff9a57; }
  }
  text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; fill: var(--muted); }
  .title { font-weight: 600; fill: var(--ink); } .paper { fill: var(--paper); } .rule { stroke: var(--rule); fill: none; }
  .time { stroke: var(--time); fill: var(--time); } .memory { stroke: var(--memory); fill: var(--memory); }
  polyline { fill: none !important; stroke-width: 2; } text.time, text.memory { stroke: none; }
</style>"""
WIDTH, HEIGHT, PAD = 300, 210, 58


def decades(values):
    return math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)) - 1e-9)


def draw(panels):
    """An SVG of the panels, both axes logarithmic."""
    all_values = [v for _, _, rows in panels for row in rows for v in row[1:]]
    y0, y1 = decades(all_values)
    lines = []
    for p, (title, note, rows) in enumerate(panels):
        left, top = PAD + (p % 2) * (WIDTH + PAD), 56 + (p // 2) * (HEIGHT + 84)
        x0, x1 = (math.log10(min(r[0] for r in rows)), math.log10(max(r[0] for r in rows)))
        at_x = lambda v: left + 12 + (WIDTH - 24) * (math.log10(v) - x0) / (x1 - x0)
        at_y = lambda v: top + HEIGHT * (y1 - math.log10(v)) / (y1 - y0)
        lines.append(f'<text class="title" x="{left}" y="{top - 26}">{title}</text>')
        lines.append(f'<text x="{left}" y="{top - 9}">{note}</text>')
        lines.append(f'<rect class="rule" x="{left}" y="{top}" width="{WIDTH}" height="{HEIGHT}"/>')
        for decade in range(y0, y1 + 1):
            y = at_y(10.0**decade)
            lines.append(f'<path class="rule" d="M{left} {y:.1f}h{WIDTH}"/>')
            lines.append(f'<text x="{left - 8}" y="{y + 4:.1f}" text-anchor="end">{10.0**decade:g}</text>')
        for x, *_ in rows:
            name = f"{x / 1000:.3g}k" if x >= 1000 else f"{x:g}"
            lines.append(f'<text x="{at_x(x):.1f}" y="{top + HEIGHT + 18}" text-anchor="middle">{name}</text>')
        for which, name in ((1, "time"), (2, "memory")):
            points = [(at_x(r[0]), at_y(r[which])) for r in rows]
            lines.append(f'<polyline class="{name}" points="' + " ".join(f"{x:.1f},{y:.1f}" for x, y in points) + '"/>')
            lines += [f'<circle class="{name}" cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in points]
    width, height = 2 * (WIDTH + PAD) + 20, 2 * (HEIGHT + 84) + 50
    legend = (
        f'<text class="time" x="{PAD}" y="{height - 14}">processor seconds</text>'
        f'<text class="memory" x="{PAD + 150}" y="{height - 14}">memory in MB</text>'
    )
    head = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="Time and memory" viewBox="0 0 {width} {height}">'
    paper = f'<rect class="paper" width="{width}" height="{height}" rx="14"/>'
    return "\n".join([head, STYLE, paper, *lines, legend, "</svg>\n"])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    measured = measure(os.path.abspath(sys.argv[1]))
    for title, note, rows in measured:
        print(f"{title} ({note})")
        for x, seconds, memory_mb in rows:
            print(f"  {x:>8g}  {seconds:8.2f} s  {memory_mb:6.0f} MB")
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write(draw(measured))
