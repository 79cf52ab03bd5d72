#!/usr/bin/env python3
"""declarations.py --check | --html HEADER... - what the public headers declare, with the comments that speak of it.

--check names each function, type, field, value and macro of which no comment speaks, and fails if there is one.
--html writes one page of all of them to standard output.

A comment speaks of what stands right below it or before it on the same line; of functions that follow each other
without an empty line, one for all. A field or a value is also spoken of where the comment of its type names it.
"""
import html
import re
import sys
from dataclasses import dataclass, field


@dataclass
class Item:
    kind: str  # function, type, field, value, macro
    name: str
    text: str  # the declaration without comments
    comment: str
    line: int
    members: list = field(default_factory=list)


@dataclass
class Header:
    path: str
    comment: str = ""
    items: list = field(default_factory=list)


TOKEN = re.compile(
    r"""(?P<comment>/\*.*?\*/)
      | (?P<macro>^[ ]*\#(?:[^\n\\]|\\.|\\\n)*)
      | (?P<end>;)
      | (?P<open>\{) | (?P<close>\})
      | (?P<text>[^;{}\s](?:[^;{}\n/]|/(?!\*))*)""",
    re.X | re.S | re.M,
)
NO_COMMENT = re.compile(r"/\*.*?\*/", re.S)


def words(comment):
    """The text of a comment on one line; empty lines and indented blocks stay apart."""
    body = re.sub(r"^/\*|\*/$", "", comment)
    return "\n".join(re.sub(r"^\s*\* ?", "", line) for line in body.split("\n")).strip()


def blank(match):
    return "\n" * match.group(0).count("\n")


def line_of(text, at):
    return text.count("\n", 0, at) + 1


def declarations(text):
    """(kind, text, first line, last line) of each comment, macro and declaration at the outermost level."""
    depth, began = 0, None
    for token in TOKEN.finditer(text):
        kind = token.lastgroup
        outside = depth == 0 and began is None
        if kind in ("comment", "macro") and outside:
            yield kind, token.group(0), line_of(text, token.start()), line_of(text, token.end())
        elif kind == "macro":
            continue
        elif kind == "end" and depth == 0 and began is not None:
            yield "declaration", text[began : token.end()], line_of(text, began), line_of(text, token.end())
            began = None
        elif kind != "comment":
            if began is None:
                began = token.start()
            depth += {"open": 1, "close": -1}.get(kind, 0)


def names_of(declaration):
    """The names that a field declares."""
    pointer = re.search(r"\(\s*\*\s*(\w+)\s*\)\s*\(", declaration)
    if pointer:
        return [pointer.group(1)]
    parts = re.sub(r"\[[^]]*\]", "", declaration).split(",")
    return [re.findall(r"\w+", part)[-1] for part in parts if re.search(r"\w", part)]


def members_of(body, separator, first_line):
    """The fields or values in the braces of a type, with their comments."""
    members, text, above, above_end, first, said = [], "", "", -1, 0, ""
    # The last value of an enum has no comma.
    body = body if separator == ";" else re.sub(r"(\w)(\s*(?:/\*.*?\*/)?\s*)$", r"\1,\2", body, flags=re.S)
    for match in re.finditer(r"/\*.*?\*/|" + separator + r"|[^\s/" + separator + r"]+", body, re.S):
        piece, line = match.group(0), line_of(body, match.start())
        if not piece.startswith("/*"):
            if piece != separator:
                first, text = (first, text + " " + piece) if text else (line, piece)
                continue
            members.append([text, said + (above if above_end == first - 1 else ""), first, line])
            text, above, said = "", "", ""
        elif text:
            said += words(piece)
        elif members and members[-1][3] == line:
            members[-1][1] += words(piece)
        else:
            above, above_end = words(piece), line_of(body, match.end())
    kind = "field" if separator == ";" else "value"
    return [
        Item(kind, name, shown, comment, first_line + first - 1)
        for shown, comment, first, _ in members
        for name in (names_of(shown) if separator == ";" else re.findall(r"^\w+", shown))
    ]


def item_of(text, comment, line):
    plain = re.sub(r"\s+", " ", NO_COMMENT.sub("", text)).strip()
    function = re.match(r"SF_API .*?\b(sf_\w+)\(", plain)
    callback = re.match(r"typedef .*\(\*(sf_\w+)\)\(", plain)
    body = re.match(r"(?:typedef\s+)?(struct|enum)\s*(\w*)\s*\{(.*)\}\s*(\w*)\s*;", text, re.S)
    if function:
        return Item("function", function.group(1), plain.replace("SF_API ", ""), comment, line)
    if callback:
        return Item("type", callback.group(1), plain, comment, line)
    if body:
        # An enum without a name goes by its first value.
        name = body.group(4) or body.group(2) or re.search(r"\w+", body.group(3)).group(0)
        separator = ";" if body.group(1) == "struct" else ","
        # Fields that a list makes are told of with the list.
        inside = re.sub(r"^ *[A-Z_]+\(.*\)$", "", body.group(3), flags=re.M)
        members = members_of(inside, separator, line + text[: text.index("{")].count("\n"))
        return Item("type", name, f"{body.group(1)} {name}", comment, line, members)
    name = re.match(r"typedef struct (\w+) \w+;", plain)
    return Item("type", name.group(1) if name else plain, plain, comment, line)


OPTION = re.compile(r'(INT|REAL|FLAG|ENUM)\((\w+), (.*?)\)(?=\s*\\?\n\s*(?:INT|REAL|FLAG|ENUM)\(|\s*$)', re.S)


def options_of(macro, line):
    """The entries of a list of options are the fields of its struct."""
    members = []
    for kind, name, rest in OPTION.findall(macro.split(")", 1)[1]):
        strings = re.findall(r'"((?:[^"\\]|\\.)*)"', rest)
        unit = "" if kind == "FLAG" else strings[0]
        text = "".join(strings[0 if kind == "FLAG" else 1 :])
        values = re.split(r'\s*,\s*', rest.split('"', 1)[0].strip().rstrip(","))
        shown = {"INT": "int64_t", "REAL": "double", "FLAG": "int", "ENUM": "int"}[kind] + f" {name} = {values[0]}"
        if len(values) > 2:
            shown += f", {values[1]}..{values[2]}"
        members.append(Item("field", name, (shown + f" {unit}").strip(), text, line))
    return members


def macro_of(text, comment, line, undefined):
    name = re.match(r"\s*#\s*define\s+(\w+)(\([^)]*\))?", text)
    if not name or name.group(1) in undefined or name.group(1).endswith("_H"):
        return None
    shown = name.group(1) + (name.group(2) or "")
    members = options_of(text[name.end() - len(name.group(2) or "") :], line) if "INT(" in text else []
    return Item("macro", name.group(1), shown, comment, line, members)


def read(path):
    with open(path, encoding="utf-8") as file:
        text = file.read()
    text = re.sub(r"#ifdef __cplusplus.*?#endif", blank, text, flags=re.S)
    undefined = re.findall(r"#undef (\w+)", text)
    header = Header(path)
    comment, comment_end, last = "", -9, None
    for kind, piece, first, end in declarations(text):
        if kind == "comment":
            same_line = last is not None and last[1] == first
            if not header.comment:
                header.comment = words(piece)
            elif same_line:
                last[0].comment = (last[0].comment + " " + words(piece)).strip()
            else:
                comment, comment_end = words(piece), end
            continue
        spoken = comment if comment_end == first - 1 else ""
        if kind == "macro":
            item = macro_of(piece, spoken, first, undefined)
        else:
            item = item_of(piece, spoken, first)
            beside = last is not None and last[1] == first - 1 and last[0].kind == "function"
            if item.kind == "function" and not item.comment and beside:
                item.comment = last[0].comment
        if item and item.name not in [other.name for other in header.items]:
            header.items.append(item)
            last = (item, end)
    return header


def silent(item):
    """Those of an item and its members that no comment speaks of."""
    if not item.comment:
        yield item
    for member in item.members:
        if not member.comment and not re.search(rf"\b{member.name}\b", item.comment):
            yield member


def check(headers):
    bad = 0
    for header in headers:
        for item in header.items:
            for missing in silent(item):
                owner = "" if missing is item else f"{item.name}."
                print(f"{header.path}:{missing.line}: no comment speaks of {missing.kind} {owner}{missing.name}")
                bad = 1
    return bad


STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:54rem;margin:2rem auto;padding:0 1rem;color:#222}
pre{background:#f3f3f0;padding:.6rem .8rem;white-space:pre-wrap;font-size:14px;border-left:3px solid #7a9}
.words{white-space:pre-line;margin:.4rem 0 1.6rem}table{border-collapse:collapse;margin:.4rem 0 1.6rem;width:100%}
td{vertical-align:top;padding:.25rem .8rem .25rem 0;border-top:1px solid #ddd}td:first-child{white-space:nowrap}
code{font-size:14px}nav{columns:2}nav p{break-inside:avoid;margin:0 0 1rem}a{color:#165}h2{margin-top:3rem}
@media(prefers-color-scheme:dark){body{background:#1b1b1a;color:#ddd}pre{background:#262624}td{border-color:#444}
a{color:#8cb}}
@media(max-width:40rem){nav{columns:1}td:first-child{white-space:normal}}"""


def paragraphs(comment):
    """Lines of one paragraph are joined; indented ones are kept."""
    joined = re.sub(r"(?<!\n)\n(?![ \n])", " ", comment)
    return html.escape(joined)


def page(headers):
    known = {item.name for header in headers for item in header.items}

    def linked(text):
        return re.sub(
            r"\b(sf_\w+|SF_\w+)\b", lambda m: f'<a href="#{m[0]}">{m[0]}</a>' if m[0] in known else m[0], text
        )

    out = ["<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'>"]
    out.append(f"<title>splatfit</title><style>{STYLE}</style><h1>splatfit: the library</h1><nav>")
    for header in headers:
        name = header.path.rsplit("/", 1)[-1]
        names = ", ".join(f'<a href="#{i.name}">{i.name}</a>' for i in header.items)
        out.append(f'<p><b><a href="#{name}">{name}</a></b><br>{names}</p>')
    out.append("</nav>")
    for header in headers:
        name = header.path.rsplit("/", 1)[-1]
        out.append(f'<h2 id="{name}">{name}</h2><p class=words>{linked(paragraphs(header.comment))}</p>')
        before = None
        for item in header.items:
            out.append(f'<pre id="{item.name}">{linked(html.escape(item.text))}</pre>')
            shared = before is not None and before.kind == "function" and before.comment == item.comment
            spoken = "As above, together." if shared else paragraphs(item.comment)
            out.append(f"<p class=words>{linked(spoken)}</p>")
            before = item
            if item.members:
                rows = "".join(
                    f"<tr><td><code>{html.escape(m.text)}</code><td>{linked(paragraphs(m.comment))}"
                    for i, m in enumerate(item.members)
                    if not i or m.text != item.members[i - 1].text
                )
                out.append(f"<table>{rows}</table>")
    return "\n".join(out) + "\n"


def main():
    if len(sys.argv) < 3 or sys.argv[1] not in ("--check", "--html"):
        print("declarations.py: --check | --html HEADER...", file=sys.stderr)
        return 2
    headers = [read(path) for path in sys.argv[2:]]
    if sys.argv[1] == "--check":
        return check(headers)
    sys.stdout.write(page(headers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
