"""The one error that users of Reposition meet: it names the thing, the limit and the cure."""


class InputError(ValueError):
    """Input that cannot be used.

    Parameters
    ----------
    thing
        What is wrong, by the name under which the user knows it (a file, a key, a column).
    limit
        The rule that it breaks, with the offending value.
    cure
        What the user can do about it.
    """

    def __init__(self, thing: str, limit: str, cure: str) -> None:
        super().__init__(f"{thing}: {limit}. {cure}.")
        self.thing, self.limit, self.cure = thing, limit, cure

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, str, str]]:
        return type(self), (self.thing, self.limit, self.cure)
