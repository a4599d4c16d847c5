"""Why the vehicle's side failed. Every message says what was found, what was needed and what to do."""


class ObserverError(Exception):
    """Any failure of this package."""


class DomainError(ObserverError):
    """The root path, a lock or a segment cannot be used."""


class Incompatible(ObserverError):
    """The other side has another version of the payload, of iceoryx2, or other qualities of service."""


class NoDaemon(ObserverError):
    """The service does not run."""


class TimedOut(ObserverError, TimeoutError):
    """Nothing came in time."""


class PortError(ObserverError):
    """iceoryx2 refused to make a node or a port, to send or to receive."""


class Refused(ObserverError):
    """The service did not carry out a command; ``reply`` has its status."""

    def __init__(self, message, reply):
        super().__init__(message)
        self.reply = reply
