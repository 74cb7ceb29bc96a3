#!/usr/bin/env python3
"""Fails, naming page and line, when a page names a file that is not there, or a function that is not in the file that
the page gives for it (`Name`, path). Pages of results and ADRs tell of the past and are left out."""
import os, re, sys

root = os.path.abspath(sys.argv[1])
PATH = r"(?:algo|calib|common|deploy|docs|drivers|firmware|hal_sim|lab|tests|cmake)(?:/[\w.-]+)+"
FILE = re.compile(rf"(?<![\w/.-])({PATH})")
NAMED = re.compile(rf"`([\w:]+)(?:\([^`]*\))?`(?:,| in) \[?`?({PATH}\.(?:h|cpp|js|py|sh))")
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#]+)")


def pages():
    for folder in ("", "docs", "docs/notes", "tests", "tests/system/rig"):
        for name in sorted(os.listdir(os.path.join(root, folder))):
            if name.endswith(".md") and name != "CHANGELOG.md":
                yield os.path.join(folder, name)


def exists(path):
    path = path.rstrip(".")
    full = os.path.join(root, path)
    folder, stem = os.path.split(full)
    return os.path.exists(full) or os.path.isdir(folder) and any(name.startswith(stem + ".") for name in os.listdir(folder))


wrong, seen = [], 0
for page in pages():
    for number, line in enumerate(open(os.path.join(root, page), encoding="utf-8"), 1):
        for path in FILE.findall(line):
            seen += 1
            if not exists(path) and not exists(os.path.join(os.path.dirname(page), path)) and not re.search(r"\b[A-Z]{4,}", path):
                wrong.append(f"{page}:{number}: {path} is not there")
        for target in LINK.findall(line):
            seen += 1
            if not os.path.exists(os.path.join(root, os.path.dirname(page), target)):
                wrong.append(f"{page}:{number}: the link to {target} leads nowhere")
        for name, path in NAMED.findall(line):
            seen += 1
            full = os.path.join(root, path)
            if os.path.exists(full) and not re.search(rf"\b{name.split('::')[-1]}\b", open(full, encoding="utf-8").read()):
                wrong.append(f"{page}:{number}: {name} is not in {path}")
print("\n".join(wrong) or f"{seen} names of files and functions are right")
sys.exit(bool(wrong) or seen < 300)
