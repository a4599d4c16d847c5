"""What all payloads have in common, and what some of them add to their fields."""

import ctypes
import math
import time

from .errors import ObserverError


class Structure(ctypes.Structure):
    """A message as it lies in shared memory. Fields are read and written as attributes."""

    #: The name under which both sides know it.
    TYPE_NAME = ""

    @classmethod
    def type_name(cls):
        """For iceoryx2, which would take the class's name."""
        return cls.TYPE_NAME

    def as_dict(self):
        """All fields as numbers, lists and dictionaries."""
        return {name: _plain(getattr(self, name)) for name, _ in self._fields_}

    def __repr__(self):
        fields = ", ".join(f"{name}={getattr(self, name)!r}" for name, _ in self._fields_)
        return f"{type(self).__name__}({fields})"

    def __eq__(self, other):
        return type(self) is type(other) and bytes(self) == bytes(other)

    __hash__ = None


def laid_out(cls):
    """Makes the fields of a message from its annotations, in their order."""
    cls._fields_ = [(name, getattr(hint, "__metadata__", (hint,))[0]) for name, hint in cls.__annotations__.items()]
    return cls


class _Array:
    """What a field of several numbers adds to a ctypes array: `field[0]`, `field[:]`, `len(field)` are ctypes' own."""

    def numpy(self):
        """A NumPy view, without a copy; it keeps the message alive. `numpy.asarray(field)` is the same."""
        try:
            import numpy
        except ImportError:
            raise ObserverError("NumPy is not installed: pip install numpy, or use list(field)") from None
        return numpy.asarray(self)

    def __repr__(self):
        return repr(list(self))

    def __eq__(self, other):
        try:
            return list(self) == list(other)
        except TypeError:
            return NotImplemented

    __hash__ = None


def array(scalar, length):
    """The type of a field with `length` numbers."""
    if (scalar, length) not in _ARRAYS:

        class Sized(_Array, scalar * length):
            pass

        Sized.__name__ = Sized.__qualname__ = f"{scalar.__name__}_{length}"
        _ARRAYS[scalar, length] = Sized
    return _ARRAYS[scalar, length]


_ARRAYS = {}


def words_of(bits, words):
    """The words of the bits that are set."""
    return [word for bit, word in words.items() if bits & bit]


def _plain(value):
    if isinstance(value, Structure):
        return value.as_dict()
    return list(value) if isinstance(value, ctypes.Array) else value


class EstimateStructure(Structure):
    """What an estimate says about itself."""

    #: Words for the bits of its status.
    WORDS = {}
    #: Fields of which infinity is a value: unknown.
    MAY_BE_INFINITE = ()

    def words(self):
        """Its status in words: `tracking`, `coasting-translation`, `stale`, ..."""
        return words_of(self.status, self.WORDS)

    def age_s(self):
        """Time since it was published (s). The last one stays when the service dies: look at its age."""
        return (time.monotonic_ns() - self.publish_stamp_ns) * 1e-9

    def is_finite(self):
        """Whether every component of state and forces is a finite number, and every deviation a number or infinity."""
        arrays = ((name, getattr(self, name)) for name, kind in self._fields_ if issubclass(kind, ctypes.Array))
        return all(
            math.isfinite(component) or (name in self.MAY_BE_INFINITE and component == math.inf)
            for name, array in arrays
            for component in array
        )


class StatusStructure(Structure):
    """What a status says in words."""

    #: Why samples were rejected, in the order of its counters.
    WORDS = ()

    def rejected(self):
        """Samples rejected, by reason; reasons that never occurred are left out."""
        return {word: n for word, n in zip(self.WORDS, self.counters.samples_rejected) if n}


class ReplyStructure(Structure):
    """A reply's text."""

    def text(self):
        """The text, or nothing where the bytes are no text."""
        end = min(self.message_bytes, len(self.message))
        try:
            return bytes(self.message[:end]).decode()
        except UnicodeDecodeError:
            return ""
