"""Scene files as text: tables of keys in the order in which they are set."""

import json
import numbers


def toml_text(value):
    """Numbers, text, truth values, and sequences of these, as TOML has them."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, numbers.Real):
        return f"{float(value):.9g}"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for the delete character. Bytes of names of files that are no UTF-8 become
        # private characters, which brume takes for the bytes.
        utf8 = "".join(chr(0xEF00 + ord(c) - 0xDC00) if 0xDC80 <= ord(c) <= 0xDCFF else c for c in value)
        return json.dumps(utf8, ensure_ascii=False).replace("\x7f", "\\u007f")
    return "[" + ", ".join(toml_text(v) for v in value) + "]"


class Table:
    def __init__(self, header):
        """@param header  '[camera]', or '[[volumes]]' for one of several"""
        self.header = header
        self._lines, self._values = {}, {}

    def set(self, **keys):
        """Numbers, text, truth values, and sequences of these."""
        for key, value in keys.items():
            self._lines[key], self._values[key] = f"{key} = {toml_text(value)}", value
        return self

    def value(self, key):
        """As it was set; None: it was not."""
        return self._values.get(key)

    def holds_any(self, keys):
        return any(key in self._lines for key in keys)

    def remove(self, keys):
        for key in keys:
            self._lines.pop(key, None)
            self._values.pop(key, None)

    def without(self, keys):
        """Another table with what is left."""
        return Table(self.header).set(**{key: value for key, value in self._values.items() if key not in keys})

    def text_without(self, keys):
        return "\n".join(line for key, line in self._lines.items() if key not in keys)

    def holds(self, **keys):
        return all(self._lines.get(key) == f"{key} = {toml_text(value)}" for key, value in keys.items())

    def assignments(self):
        """As -D takes them."""
        return [f"{self.header.strip('[]')}.{line.replace(' = ', '=', 1)}" for line in self._lines.values()]

    def text(self):
        return "\n".join([self.header, *self._lines.values()]) + "\n"
