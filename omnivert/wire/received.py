"""A message that arrived, opened."""

from dataclasses import dataclass

from omnivert.messages import Message
from omnivert.wire.channels import Channel
from omnivert.wire.codec import decode
from omnivert.wire.envelope import THIS_CLOCK
from omnivert.wire.forms import WireError
from omnivert.wire.inbox import Parcel


@dataclass(frozen=True, slots=True)
class Received:
    """
    sent_ns     when it was published, on the publisher's monotonic clock
    replay      a recording plays, instead of a live robot
    run         names the process from whose sensor data it comes
    publisher   names the process that published it
    sequence    its number among that process's messages on this key
    same_clock  whether `sent_ns` is of this host's clock
    data        the message's bytes, for whoever keeps them
    """

    channel: Channel
    key: str
    message: Message
    sent_ns: int
    replay: bool
    run: bytes
    publisher: bytes
    sequence: int
    same_clock: bool = True
    data: bytes = b""


def opened(parcel: Parcel) -> Received:
    """raises WireError when there is no message of its channel in it"""
    envelope = parcel.envelope
    return Received(
        channel=parcel.channel,
        key=parcel.key,
        message=message_of(parcel.channel, parcel.data),
        sent_ns=envelope.sent_ns,
        replay=envelope.replay,
        run=envelope.run,
        publisher=envelope.incarnation,
        sequence=envelope.sequence,
        same_clock=envelope.clock == THIS_CLOCK,
        data=parcel.data,
    )


def message_of(channel: Channel, data: bytes) -> Message:
    """raises WireError when these bytes are no message of the channel"""
    message = decode(data)
    if type(message) is not channel.message:
        raise WireError(f"not {channel.message.__name__}")
    return message
