"""An example in Python prints what the comment at its end says. Argument: the example.

"Prints without the package NAME" says what it skips; with the package it must do its work."""
import importlib.util, re, subprocess, sys

text = open(sys.argv[1], encoding="utf-8").read()
block = re.search(r"\n# Prints(?: without the package (\w+))?:\n((?:# ?.*\n)+)\Z", text)
expected = "\n".join(line[2:] for line in block[2].splitlines()) + "\n"
r = subprocess.run([sys.executable, sys.argv[1]], capture_output=True, text=True, timeout=100)
if block[1] and importlib.util.find_spec(block[1]):
    sys.exit(f"{r.stdout}{r.stderr}" if r.returncode or not r.stdout or "SKIPPED" in r.stdout else 0)
if (r.returncode, r.stdout, r.stderr) != (0, expected, ""):
    sys.exit(f"exit code {r.returncode}\n{r.stderr}prints\n{r.stdout}but the comment in {sys.argv[1]} says\n{expected}")
