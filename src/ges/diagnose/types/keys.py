"""Names that are made of parts: keys of parameters, and channels under their test functions."""

from __future__ import annotations

from typing import NamedTuple


class ParameterKey(NamedTuple):
    """A parameter of an effect, or of ``vehicle``; as text ``rotor_drag.k_kg``.

    Attributes
    ----------
    effect : name of the effect.
    parameter : name of its parameter; '' where the text has none.
    """

    effect: str
    parameter: str

    @classmethod
    def of(cls, text: str) -> ParameterKey:
        """Read a key.

        Parameters
        ----------
        text : as ``rotor_drag.k_kg``.

        Examples
        --------
        >>> ParameterKey.of("rotor_drag.k_kg").parameter
        'k_kg'
        """
        effect, _, parameter = text.partition(".")
        return cls(effect, parameter)


class MarkedChannel(NamedTuple):
    """A channel under one of its test functions; as text ``moment_x/1``.

    Attributes
    ----------
    channel : name of the channel, ``moment_x``.
    mark : ``/1`` of the first of the faster test functions; '' for the plain average.
    """

    channel: str
    mark: str

    @classmethod
    def of(cls, text: str) -> MarkedChannel:
        """Read the name of a channel.

        Parameters
        ----------
        text : as ``moment_x`` or ``moment_x/1``.

        Examples
        --------
        >>> MarkedChannel.of("moment_x/1").mark
        '/1'
        """
        channel, slash, number = text.partition("/")
        return cls(channel, slash + number)
