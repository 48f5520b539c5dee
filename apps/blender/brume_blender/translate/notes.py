"""What a translation leaves out or replaces, each said once."""


class LeftOut(Exception):
    """Why an object, or a part of one, is not in the scene that brume renders."""


class CannotTranslate(Exception):
    """Why there is no scene at all: what Blender's report says."""


class Notes:
    """Lines of what was left out or replaced, with the names of the things that they are about, in the order in which they were met."""

    NAMES = 8  # that a line lists before it counts

    def __init__(self):
        self._things = {}

    def say(self, thing, text):
        """@param thing  name of an object, material or setting   @param text  what became of it"""
        thing = " ".join(thing.split("\n"))
        names = self._things.setdefault(text, [])
        if thing not in names:
            names.append(thing)

    def tell(self, other):
        """Says all of it to other Notes."""
        for text, names in self._things.items():
            for name in names:
                other.say(name, text)

    def lines(self):
        return [self._names(names) + ": " + text for text, names in self._things.items()]

    def _names(self, names):
        more = len(names) - self.NAMES
        return ", ".join(names[: self.NAMES]) + (f" and {more} more" if more > 0 else "")
