#!/usr/bin/env python3
"""Checks the pages: links and pictures lead to files that exist, anchors to headings, and docs/SUMMARY.md lists every page of docs/ once.

    scripts/links.py                       # exit code 1 if anything is wrong
    scripts/links.py --book target/book    # the pages of a built book instead: links, pictures and anchors of its HTML
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\]\(([^)\s]+)\)|<img [^>]*src=\"([^\"]+)\"")
FENCE = re.compile(r"^( *)(```|~~~).*?^ *\2", re.MULTILINE | re.DOTALL)


def prose(path):
    """The text of a page without its code."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    return re.sub(r"`[^`\n]*`(?!\])", "", text)


def anchors(path):
    """Anchors of the headings of a page, as forges make them."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    found = {}
    for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        name = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        found[name] = found.get(name, -1) + 1
    return {f"{name}-{i}" if i else name for name, count in found.items() for i in range(count + 1)}


class Html(HTMLParser):
    """Links and anchors of a page of the book."""

    def __init__(self, page):
        super().__init__()
        self.links, self.anchors = [], set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        of = dict(attributes)
        self.anchors.add(of.get("id"))
        self.links += [of[key] for key in ("href", "src") if of.get(key)]


def book(folder):
    # These repeat the others' links, from elsewhere.
    pages = {page: Html(page) for page in sorted(folder.rglob("*.html")) if page.name not in ("404.html", "print.html", "toc.html")}
    faults = [] if pages else [f"{folder}: there is no book; build it by mdbook build"]
    for page, html in pages.items():
        for target in (link for link in html.links if not re.match(r"[a-z]+:", link)):
            name, _, anchor = target.partition("#")
            file = (page.parent / unquote(name)).resolve() if name else page
            where = f"{page.relative_to(folder)}: {target}"
            if not file.exists():
                faults.append(f"{where}: there is no such file")
            elif anchor and file in pages and unquote(anchor) not in pages[file].anchors:
                faults.append(f"{where}: there is no such heading")
    print("\n".join(faults) or f"{sum(len(html.links) for html in pages.values())} links in {len(pages)} pages of the book")
    return 1 if faults else 0


def main():
    if sys.argv[1:2] == ["--book"] and len(sys.argv) == 3:
        return book(Path(sys.argv[2]).resolve())
    faults, links = [], 0
    pages = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("scenes/*/README.md")])
    for page in pages:
        for match in LINK.finditer(prose(page)):
            target = match.group(1) or match.group(2)
            if re.match(r"[a-z]+:", target):
                continue
            links += 1
            name, _, anchor = target.partition("#")
            file = (page.parent / name).resolve() if name else page
            where = f"{page.relative_to(ROOT)}: {target}"
            if not file.exists():
                faults.append(f"{where}: there is no such file")
            elif anchor and file.suffix == ".md" and anchor not in anchors(file):
                faults.append(f"{where}: there is no such heading")

    listed = re.findall(r"\]\(([^)]+)\)", (ROOT / "docs/SUMMARY.md").read_text(encoding="utf-8"))
    there = {page.name for page in (ROOT / "docs").glob("*.md")} - {"SUMMARY.md"}
    faults += [f"docs/SUMMARY.md: {name} is not listed" for name in sorted(there - set(listed))]
    faults += [f"docs/SUMMARY.md: {name} is listed twice" for name in sorted(set(listed)) if listed.count(name) > 1]

    print("\n".join(faults) or f"{links} links in {len(pages)} pages")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
