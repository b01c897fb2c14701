"""An example in Python prints what the comment at its end says. Argument: the example."""
import re, subprocess, sys

text = open(sys.argv[1], encoding="utf-8").read()
block = re.search(r"\n# Prints:\n((?:# ?.*\n)+)\Z", text)
expected = "\n".join(line[2:] for line in block[1].splitlines()) + "\n"
r = subprocess.run([sys.executable, sys.argv[1]], capture_output=True, text=True, timeout=100)
if (r.returncode, r.stdout, r.stderr) != (0, expected, ""):
    sys.exit(f"exit code {r.returncode}\n{r.stderr}prints\n{r.stdout}but the comment in {sys.argv[1]} says\n{expected}")
