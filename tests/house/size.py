#!/usr/bin/env python3
"""No line over 120 columns and no function over 100 lines; one over 60 lines gives its reason in its first line."""
import ast
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
        end = next((j for j in range(i + 1, len(lines)) if lines[j].startswith(' ' * indent + '}')), len(lines))
        yield i, re.sub(r'\(.*', '', head).split()[-1], end - first + 1


def python_functions(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node.lineno - 1, node.name, node.end_lineno - node.lineno + 1
