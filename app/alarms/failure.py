"""Why a message was not taken."""


class DeliveryError(Exception):
    """The receiver did not take a message; the text says why and holds no secret."""


class RefusedError(DeliveryError):
    """The receiver will not take it however often it is sent."""
