"""Lines and branches that tests reached, by folder, from the .gcda files of a build with --coverage: coverage.py BUILD.
A branch is a way out of a decision; those of exceptions do not count. Exit code 1 where there is nothing to read."""
import collections, json, os, subprocess, sys

root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
build = os.path.abspath(sys.argv[1])
reached = {}  # (file, line) or (file, line, branch): how often, by any program
for folder, _, files in os.walk(build):
    notes = [os.path.join(folder, file) for file in files if file.endswith(".gcda")]
    command = ["gcov", "--json-format", "--branch-probabilities", "--stdout"]
    answer = subprocess.run(command + notes, capture_output=True, text=True, cwd=folder).stdout if notes else ""
    for unit in map(json.loads, answer.splitlines()):
        for file in unit["files"]:
            path = os.path.relpath(os.path.realpath(os.path.join(folder, file["file"])), root)
            if not path.startswith(("plugins/", "twin/", "hil/", "render/")):
                continue
            for line in file["lines"]:
                places = {(path, line["line_number"]): line["count"]}
                ways = [way for way in line["branches"] if not way["throw"]]
                places |= {(path, line["line_number"], k): way["count"] for k, way in enumerate(ways)}
                for place, count in places.items():
                    reached[place] = reached.get(place, 0) + count

tables = {kind: collections.defaultdict(list) for kind in ("lines", "branches")}
for (path, *where), count in reached.items():
    tables["lines" if len(where) == 1 else "branches"][os.path.dirname(path)].append(count > 0)
print("| folder | lines | reached | branches | reached |\n|---|---|---|---|---|")
for name in sorted(tables["lines"]):
    sizes = [(len(table[name]), sum(table[name]) / max(1, len(table[name]))) for table in tables.values()]
    print(f"| {name} | " + " | ".join(f"{size} | {100 * share:.0f} %" for size, share in sizes) + " |")
sys.exit(not reached)
