"""An example prints what the comment at its end says. Arguments: its source, its program, the program's arguments."""
import re, subprocess, sys

source, *command = sys.argv[1:]
text = open(source, encoding="utf-8").read()
block = re.search(r"\n// Prints:\n((?:// ?.*\n)+)\Z", text)
expected = "\n".join(line[3:] for line in block[1].splitlines()) + "\n"
r = subprocess.run(command, capture_output=True, text=True, timeout=100)
if (r.returncode, r.stdout, r.stderr) != (0, expected, ""):
    sys.exit(f"exit code {r.returncode}\n{r.stderr}prints\n{r.stdout}but the comment in {source} says\n{expected}")
