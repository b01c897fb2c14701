#!/usr/bin/env python3
"""No line over 120 columns and no function over 100 lines; one over 60 gives its reason in its first line.
Argument: source tree."""
import ast
import os
import pathlib
import re
import subprocess
import sys

LINE, SHORT, LONG = 120, 60, 100
NOT_A_FUNCTION = re.compile(
    r'^\s*(namespace|struct|class|enum|union|extern "C"|(inline |static )*const\w* .*[=\]]\s*\{$)'
)


def cpp_functions(lines):
    """(first line, name, length) of every function at namespace or class level of a formatted file."""
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if indent > 4 or not line.rstrip().endswith('{') or NOT_A_FUNCTION.match(line):
            continue
        first = i
        while first > 0 and not re.match(r'^\s*$|.*[;{}:]$|^\s*(//|#)', lines[first - 1]):
            first -= 1
        head = ' '.join(x.strip() for x in lines[first : i + 1])
        if '(' not in head or NOT_A_FUNCTION.match(head) or re.match(r'(if|for|while|switch|else|do|return)\b', head):
            continue
        if line.lstrip().startswith(':'):  # the members of a constructor, indented by four
            indent -= 4
        end = next((j for j in range(i + 1, len(lines)) if lines[j].startswith(' ' * indent + '}')), len(lines))
        yield i, re.sub(r'\(.*', '', head).split()[-1], end - first + 1


def python_functions(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node.lineno - 1, node.name, node.end_lineno - node.lineno + 1


def short_enough(path, first, name, length, comment):
    if length > LONG:
        return [f"{path}:{first + 1}: {name} has {length} lines; at most {LONG}"]
    if length > SHORT and not comment:
        return [f"{path}:{first + 1}: {name} has {length} lines; its first line must say why it is longer than {SHORT}"]
    return []


def cpp_problems(path, lines):
    for first, name, length in cpp_functions(lines):
        reason = first + 1 < len(lines) and lines[first + 1].strip().startswith('//')
        yield from short_enough(path, first, name, length, reason)


def python_problems(path, text):
    lines = text.splitlines()
    for first, name, length in python_functions(text):
        body = [line.strip() for line in lines[first : first + 12]]
        reason = any(line.startswith(('#', '"""')) for line in body)
        yield from short_enough(path, first, name, length, reason)


# Tables of numbers and what other programs wrote, which have no place to break a line.
DATA = ('.csv', '.json', '.log', '.svg', '.png', '.eds', '.dbc')


def too_long(path, lines):
    for number, line in enumerate(lines, 1):
        row = path.endswith('.md') and line.lstrip().startswith('|')  # Markdown cannot break the row of a table
        if len(line) > LINE and not row:
            yield f"{path}:{number}: {len(line)} columns; at most {LINE}"


def problems_of(path):
    try:
        text = pathlib.Path(path).read_text(encoding='utf-8')
    except UnicodeDecodeError:
        return
    lines = text.splitlines()
    if not path.endswith(DATA) and not path.startswith('tests/fuzz/corpus/'):
        yield from too_long(path, lines)
    if path.endswith(('.cc', '.hpp', '.inc')):
        yield from cpp_problems(path, lines)
    elif path.endswith('.py'):
        yield from python_problems(path, text)


if __name__ == '__main__':
    files = subprocess.run(['git', '-C', sys.argv[1], 'ls-files', '-z'], capture_output=True, text=True)
    if files.returncode:
        sys.exit('SKIPPED: not a git checkout')  # an export of the sources has no list of tracked files
    os.chdir(sys.argv[1])
    found = [p for path in files.stdout.split('\0') if os.path.isfile(path) for p in problems_of(path)]
    print('\n'.join(found))
    sys.exit(bool(found))
