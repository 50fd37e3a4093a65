"""A small interpreter of Structured Text for the tests of function blocks.

It knows the statements that the blocks use and is strict where controllers are: types, array bounds.
"""

import re
from typing import Any

import numpy as np

KINDS = {"LREAL": float, "DINT": int, "BOOL": bool}
TOKEN = re.compile(r"\d+\.\d+(?:E[+-]?\d+)?|\d+|[A-Za-z_]\w*|:=|<>|<=|>=|\.\.|[-+*/()\[\],:;=<>]|\S")
PYTHON = {"AND": "and", "OR": "or", "NOT": "not", "<>": "!=", "=": "==", "TRUE": "True", "FALSE": "False"}
PYTHON |= {"ABS": "abs", "LREAL_TO_DINT": "to_dint", "DINT_TO_LREAL": "float"}


class Numbers(list):
    """An array of a controller: of one type, without negative indices."""

    def __init__(self, kind, items):
        super().__init__(items)
        self.kind = kind

    def __getitem__(self, index):
        assert 0 <= index < len(self), f"index {index} of {len(self)}"
        return super().__getitem__(index)

    def __setitem__(self, index, value):
        assert 0 <= index < len(self), f"index {index} of {len(self)}"
        assert type(value) is self.kind, (value, self.kind)
        super().__setitem__(index, value)


class Block:
    """An instance of the one function block of a source; its variables are attributes, a call is a cycle."""

    def __init__(self, source, to_dint=round):
        text = re.sub(r"\(\*.*?\*\)", "", source, flags=re.S)
        ((self.__dict__["block"], inner),) = re.findall(r"FUNCTION_BLOCK (\w+)(.*)END_FUNCTION_BLOCK", text, re.S)
        self.__dict__["kinds"] = {}
        for section in re.findall(r"VAR(?:_INPUT|_OUTPUT)?\b(.*?)END_VAR", inner, re.S):
            for declaration in filter(str.strip, section.split(";")):
                self.declare(declaration)
        body = inner[inner.rindex("END_VAR") + len("END_VAR") :]
        self.__dict__["tokens"] = TOKEN.findall(body)
        lines = ["def run(v):", *self.statements(1, {None}), "    return"]
        space = {"to_dint": to_dint}
        exec("\n".join(lines), space)
        self.__dict__["run"] = space["run"]

    def declare(self, text):
        form = r"\s*(\w+)\s*:\s*(?:ARRAY \[0\.\.(\d+)\] OF )?(\w+)\s*(?::=\s*(.+?))?\s*"
        found = re.fullmatch(form, text, re.S)
        assert found, text
        name, array, kind, value = found.groups()
        kind = self.kinds[name] = KINDS[kind]
        read = lambda word: kind(word == "TRUE") if kind is bool else kind(word)
        if array is None:
            self.__dict__[name] = kind() if value is None else read(value)
            return
        size = int(array) + 1
        items = [kind()] * size if value is None else [read(word) for word in value.strip("[]").split(",")]
        assert len(items) == size
        self.__dict__[name] = Numbers(kind, items)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __setattr__(self, name, value):
        if isinstance(self.__dict__[name], Numbers):
            value = Numbers(self.kinds[name], value)
        else:
            assert type(value) is self.kinds[name], (name, value)
        self.__dict__[name] = value

    def __call__(self, **inputs):
        for name, value in inputs.items():
            setattr(self, name, value)
        self.run(self)

    def take(self, *wanted):
        token = self.tokens.pop(0)
        assert not wanted or token in wanted, (token, wanted, self.tokens[:9])
        return token

    def expression(self, *ends):
        words = []
        while self.tokens[0] not in ends:
            word = self.take()
            words.append(PYTHON.get(word) or (f"v.{word}" if word in self.kinds else word))
            assert word[0].isdigit() or not word[0].isalpha() or word in PYTHON or word in self.kinds, word
        self.take(*ends)
        return " ".join(words)

    def statements(self, depth, ends):
        lines, pad = [], "    " * depth
        while (self.tokens[0] if self.tokens else None) not in ends:
            word = self.take()
            if word == "IF":
                lines.append(f"{pad}if {self.expression('THEN')}:")
                lines += self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
                while (word := self.take("ELSIF", "ELSE", "END_IF")) != "END_IF":
                    lines.append(f"{pad}else:" if word == "ELSE" else f"{pad}elif {self.expression('THEN')}:")
                    lines += self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
                self.take(";")
            elif word == "FOR":
                index = self.take()
                assert self.kinds[index] is int
                self.take(":=")
                first, last = self.expression("TO"), self.expression("DO")
                lines.append(f"{pad}for v.{index} in range({first}, {last} + 1):")
                lines += self.statements(depth + 1, {"END_FOR"})
                self.take("END_FOR")
                self.take(";")
            elif word == "RETURN":
                lines.append(f"{pad}return")
                self.take(";")
            else:
                assert word in self.kinds, word
                target = f"v.{word}"
                if self.tokens[0] == "[":
                    self.take("[")
                    target += f"[{self.expression(']')}]"
                self.take(":=")
                lines.append(f"{pad}{target} = {self.expression(';')}")
        return lines


def shaped(block, commands, **inputs):
    found = []
    for command in commands:
        block(Command=float(command), **inputs)
        found.append(block.Shaped)
    return np.array(found)
