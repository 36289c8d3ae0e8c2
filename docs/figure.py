"""Takes one chart out of a sweep's report.html and makes it a picture of its own, for light and dark pages.

    cargo run --release -- sweep rooms/sliding-door.toml
    python3 docs/figure.py out/sliding-door/report.html "line → mic-0, 1 kHz" docs/sliding-door.svg
"""

import re
import sys

STYLE = """<style>
  svg { --paper: #fff; --ink: #1c2330; --muted: #5b6676; --rule: #dde1e8; --grid: #e6e9ee; --level: #1f6fb5; --reference: #10151d; --rise: #e8590c; }
  @media (prefers-color-scheme: dark) {
    svg { --paper: #14181f; --ink: #e4e8ef; --muted: #98a4b5; --rule: #323b49; --grid: #2a323e; --level: #6cb2f2; --reference: #f6f8fb; --rise: #ff9a57; }
  }
  text { font-family: system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
  polyline { stroke-linejoin: round; stroke-linecap: round; }
  .paper { fill: var(--paper); stroke: var(--rule); } .title { fill: var(--ink); }
  .f-text { fill: var(--muted); } .s-grid { stroke: var(--grid); } .s-axis { stroke: var(--rule); }
  .s-level { stroke: var(--level); } .f-level { fill: var(--level); }
  .s-reference { stroke: var(--reference); stroke-dasharray: 12 9; } .f-rise { fill: var(--rise); opacity: .2; }
</style>"""


def main(report, title, target):
    page = open(report, encoding="utf-8").read()
    for svg in re.findall(r"<svg role=.*?</svg>", page, re.S):
        label = re.search(r'aria-label="(.*?)"', svg).group(1)
        if label.endswith(title):
            break
    else:
        sys.exit(f"{report} has no chart of {title}")
    width, height = map(int, re.search(r'viewBox="0 0 (\d+) (\d+)"', svg).groups())
    inside = svg[svg.index(">") + 1 : svg.rindex("</svg>")]
    inside = inside.replace("opening.door.open_m (m)", "door open (m)")
    head, legend = 62, 56
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{label}" '
        f'viewBox="-24 0 {width + 48} {height + head + legend}" width="{(width + 48) * 4 // 5}">',
        STYLE,
        f'<rect class="paper" x="-23" y="1" width="{width + 46}" height="{height + head + legend - 2}" rx="14"/>',
        '<text class="title" x="8" y="44" font-size="30" font-weight="600">Closing the door makes it louder behind it</text>',
        f'<g transform="translate(0 {head})">{inside}</g>',
        f'<g transform="translate(118 {head + height + 18})" font-size="25">',
        '<line x1="0" x2="44" y1="0" y2="0" class="s-level" stroke-width="5"/><text class="f-text" x="56" y="8">diffray</text>',
        '<line x1="170" x2="214" y1="0" y2="0" class="s-reference" stroke-width="4"/>'
        '<text class="f-text" x="226" y="8">exact theory</text>',
        '<rect x="400" y="-14" width="44" height="28" class="f-rise"/><text class="f-text" x="456" y="8">rise on closing</text>',
        "</g>",
        "</svg>",
    ]
    with open(target, "w", encoding="utf-8") as out:
        out.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
