"""One splitter a sender address, for few of them: a sender with many addresses takes no memory."""

from collections import OrderedDict

from drivers.mavlink.framing import FrameSplitter
from drivers.mavlink.ports import Address

MOST_SENDERS = 32


class SenderSplitters:
    """The splitters of the senders that were heard last; the one to ``keep`` is never given up for others."""

    def __init__(self) -> None:
        self._splitters: OrderedDict[Address, FrameSplitter] = OrderedDict()

    def __len__(self) -> int:
        return len(self._splitters)

    def of(self, sender: Address, keep: Address = None) -> FrameSplitter:
        """The sender's splitter, a new one where it has none."""
        splitter = self._splitters.setdefault(sender, FrameSplitter())
        self._splitters.move_to_end(sender)
        if len(self._splitters) > MOST_SENDERS:
            oldest = next(address for address in self._splitters if address != keep)
            del self._splitters[oldest]
        return splitter

    def clear(self) -> None:
        """Forget all."""
        self._splitters.clear()
