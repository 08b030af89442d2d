#!/usr/bin/env python3
"""Preprocessor of the book: files outside of docs/ that pages link to become pages of the book, under "Sources".

mdBook calls it as book.toml says. Links such as ../src/bsdf.rs lead to the file where the pages are read in a checkout, and to its page in the
book.

    scripts/book_sources.py --check     every link of the pages out of docs/ leads to a page; exit code 1 if not
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)\s]*)?(\))")
LANGUAGES = {".rs": "rust,ignore", ".py": "python", ".sh": "sh", ".toml": "toml", ".wgsl": "wgsl", ".glsl": "glsl", ".html": "html", ".json": "json"}


def inside(path, folder):
    return path == folder or folder in path.parents


class Sources:
    """The pages that are added."""

    def __init__(self):
        self.pages = {}

    def page(self, path):
        """Place in the book of a file or a folder of the checkout, which gets a page."""
        place = f"source/{path.relative_to(ROOT).as_posix()}.md"
        if place not in self.pages:
            self.pages[place] = ""
            self.pages[place] = self.text(path, place)
        return place

    def text(self, path, place):
        title = f"# {path.relative_to(ROOT).as_posix()}\n\n"
        if path.is_dir():
            files = sorted(entry for entry in path.iterdir() if entry.is_file())
            return title + "".join(f"- [{file.name}]({self.relative(file, place)})\n" for file in files)
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".md":
            return self.linked(text, path.parent, place)
        fence = "`" * (1 + max([2, *map(len, re.findall(r"`+", text))]))
        return f"{title}{fence}{LANGUAGES.get(path.suffix, 'text')}\n{text.rstrip()}\n{fence}\n"

    def relative(self, path, place):
        """Link from a page of the book to a file of the checkout."""
        target = path.relative_to(DOCS).as_posix() if inside(path, DOCS) else self.page(path)
        return "../" * place.count("/") + target

    def linked(self, text, folder, place):
        """The text of a page whose links start in a folder of the checkout, for its place in the book."""

        def link(match):
            path = (folder / match[2]).resolve()
            if re.match(r"[a-z]+:", match[2]) or not inside(path, ROOT) or not path.exists() or inside(path, DOCS) and folder == DOCS:
                return match[0]
            return f"{match[1]}{self.relative(path, place)}{match[3] or ''}{match[4]}"

        return LINK.sub(link, text)


def chapters(items):
    for item in items:
        chapter = item.get("Chapter") if isinstance(item, dict) else None
        if chapter is not None:
            yield chapter
            yield from chapters(chapter["sub_items"])


def chapter(name, content, place, parents, below=()):
    return {"Chapter": {"name": name, "content": content, "number": None, "sub_items": list(below), "path": place, "source_path": None, "parent_names": parents}}


def preprocess(book):
    # The list was called sections up to mdBook 0.4.
    items = book["items" if "items" in book else "sections"]
    sources = Sources()
    for page in list(chapters(items)):
        if page["path"] is not None:
            page["content"] = sources.linked(page["content"], DOCS, page["path"])
    added = [chapter(place[len("source/") : -len(".md")], text, place, ["Sources"]) for place, text in sorted(sources.pages.items())]
    if added:
        items.append(chapter("Sources", "# Sources\n\nFiles of the checkout that the pages name.\n", "source.md", [], added))
    return book


def check():
    """A book of all pages, without mdBook: links out of docs/ are left in none of its pages."""
    pages = sorted(page for page in DOCS.glob("*.md") if page.name != "SUMMARY.md")
    book = {"items": [chapter(page.stem, page.read_text(encoding="utf-8"), page.name, []) for page in pages]}
    made = {page["path"]: page["content"] for page in chapters(preprocess(book)["items"])}
    faults = []
    for place, text in made.items():
        if place.startswith("source/") and not place.endswith(".md.md"):
            continue
        for match in LINK.finditer(re.sub(r"```.*?```", "", text, flags=re.DOTALL)):
            if re.match(r"[a-z]+:", match[2]):
                continue
            target = (Path("/book") / place).parent.joinpath(match[2]).resolve().relative_to("/book").as_posix()
            if target not in made and (target.endswith(".md") or not (DOCS / target).exists()):
                faults.append(f"{place}: {match[2]} leads out of the book")
    print("\n".join(faults) or f"{len(made)} pages, {sum(place.startswith('source/') for place in made)} of them sources")
    return 1 if faults else 0


def main():
    if sys.argv[1:] == ["--check"]:
        return check()
    if sys.argv[1:2] == ["supports"]:
        return 0 if sys.argv[2:] == ["html"] else 1
    _, book = json.load(sys.stdin)
    json.dump(preprocess(book), sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
