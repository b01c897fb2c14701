#!/usr/bin/env python3
"""Runs the printed text of README files as a reader would paste it.

    readme_lines.py SOURCE BIN README...        READMEs as paths within SOURCE

Each README gets a fresh folder that holds the tree under the names that a clone has, with the programs of BIN in
build/release/bin, the examples built with them in build/release/examples and the Python module in
build/release/python. Its fenced blocks are taken in the order printed:

    ```bash             every line is run, in one shell; it must end with exit code 0, or with the code that its comment
                        documents ("# ... exit code 3 ...")
    ```yaml FILE        the text is written to FILE; so are xml and csv blocks that name a file
    ```python           run by python3 where numpy and h5py are installed
    ```cpp              the lines must stand, in this order, in a file of an examples/ folder, which the build compiles

Other fences and indented text are not run. Relative links, and files named in the first column of a table, must exist.
"""
import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import time

# Run elsewhere: by the build itself, and by whoever runs this test.
RUN_ELSEWHERE = ('bash twin/quickstart.sh', 'bash tests/run.sh')
PARTS = ('mjcf', 'plugins', 'twin', 'hil', 'render', 'tests')
LONGEST_S = 600  # of one README, on a busy machine


def blocks(text):
    """(language, file or '', first line number, lines) of every fenced block."""
    fence = None
    for number, line in enumerate(text.splitlines(), 1):
        start = re.match(r'\s*```(\w*) *(\S*)', line)
        if fence is None and start:
            fence = (start[1], start[2], number + 1, [])
        elif fence is not None and line.strip() == '```':
            yield fence
            fence = None
        elif fence is not None:
            fence[3].append(line)
    assert fence is None, 'a fence is not closed'


def commands(first, lines):
    """(line number, command) of a bash block; continued lines, loops and here-documents are one command."""
    i = 0
    while i < len(lines):
        start, command = i, lines[i]
        while command.endswith('\\') and i + 1 < len(lines):
            i += 1
            command += '\n' + lines[i]
        end = re.search(r"<<'?(\w+)'?", command) or re.match(r'(?:for|while)\b(?!.*\bdone\b)', command) and [0, 'done']
        while end and lines[i].strip() != end[1]:
            i += 1
            command += '\n' + lines[i]
        i += 1
        stripped = re.sub(r'\s+#.*', '', command).strip()
        if stripped and not stripped.startswith('#') and stripped not in RUN_ELSEWHERE:
            yield first + start, command


def documented_exit(command):
    found = re.search(r'#.*\bexit code (\d+)', command)
    return int(found[1]) if found else 0


def script_of(readme, text):
    """One shell script with every line of the bash blocks; it stops at the first line that ends otherwise."""
    script = ['export PATH="$PWD/build/release/bin:$PATH"']
    count = 0
    for language, file, first, lines in blocks(text):
        if language in ('yaml', 'xml', 'csv') and file:
            script.append(f"cat > {file} <<'END_OF_BLOCK'\n" + '\n'.join(lines) + '\nEND_OF_BLOCK')
        elif language == 'python':
            code = '\n'.join(lines)
            script.append(
                "if /usr/bin/python3 -c 'import h5py, numpy' 2> /dev/null; then\n"
                f"/usr/bin/python3 - <<'END_OF_BLOCK' || {{ echo '{readme}:{first}: python failed' >&2; exit 99; }}\n"
                f'{code}\nEND_OF_BLOCK\nfi'
            )
        elif language == 'bash':
            for number, command in commands(first, lines):
                expected = documented_exit(command)
                script.append(f'{command}\ncode=$?')
                script.append(
                    f'[ $code -eq {expected} ] || {{ echo "{readme}:{number}: exit code $code, not {expected}" >&2; '
                    'exit 99; }'
                )
                count += 1
    return '\n'.join(script) + '\nwait\n', count


def squeezed(lines):
    return [line.strip() for line in lines if line.strip()]


def not_in_an_example(source, lines):
    """Whether no file of an examples/ folder holds these lines in this order, one after the other."""
    wanted = squeezed(lines)
    for file in source.glob('*/examples/*.cc'):
        have = squeezed(file.read_text().splitlines())
        if any(have[i : i + len(wanted)] == wanted for i in range(len(have))):
            return False
    return True


def static_problems(source, readme):
    path = source / readme
    text = path.read_text()
    problems = []
    prose = re.sub(r'```.*?```', '', text, flags=re.DOTALL)
    for target in re.findall(r'\]\(([^)#\s]+)(?:#[^)]*)?\)', prose):
        if not re.match(r'\w+:', target) and not (path.parent / target).exists():
            problems.append(f'{readme}: link to {target}, which does not exist')
    for row in re.findall(r'^\| *(`[^|]*?) *\|', prose, re.MULTILINE):
        for name in re.findall(r'`([\w/]+\.(?:hpp|cc|c|py|sh))`', row):
            if 'NAME' not in name and not (path.parent / name).exists() and not (source / name).exists():
                problems.append(f'{readme}: names {name}, which does not exist')
    for language, _, first, lines in blocks(text):
        if language == 'cpp' and not_in_an_example(source, lines):
            problems.append(f'{readme}:{first}: these lines stand in no file of an examples/ folder')
    return problems


def run(source, programs, readme):
    """Problems of one README; its commands run in a folder that is removed afterwards."""
    script, count = script_of(readme, (source / readme).read_text())
    if count == 0:
        return [], 0
    with tempfile.TemporaryDirectory(prefix='readme_') as folder:
        root = pathlib.Path(folder)
        for part in PARTS:
            (root / part).symlink_to(source / part)
        (root / 'build/release').mkdir(parents=True)
        (root / 'build/release/bin').symlink_to(programs)
        for made in ('examples', 'python'):
            (root / 'build/release' / made).symlink_to(programs.parent / made)
        try:
            done = subprocess.run(
                ['bash', '-c', script], cwd=root, capture_output=True, text=True, timeout=LONGEST_S, errors='replace'
            )
        except subprocess.TimeoutExpired as late:
            return [f'{readme}: not done after {late.timeout:.0f} s'], count
        if done.returncode:
            return [f'{readme}: exit code {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}'], count
    return [], count


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('source', type=pathlib.Path)
    parser.add_argument('programs', type=pathlib.Path)
    parser.add_argument('readmes', nargs='+')
    options = parser.parse_args()
    source, programs = options.source.resolve(), options.programs.resolve()
    problems, total = [], 0
    for readme in options.readmes:
        begin = time.monotonic()
        failed = static_problems(source, readme)
        ran, count = run(source, programs, readme)
        total += count
        print(f'{readme}: {count} lines, {time.monotonic() - begin:.1f} s', flush=True)
        problems += failed + ran
    print(f'{total} lines in all')
    print('\n'.join(problems))
    return bool(problems)


if __name__ == '__main__':
    sys.exit(main())
