"""Other programs beside us: every byte of the vehicle goes to them, every frame of theirs goes to the vehicle."""

from collections.abc import Callable, Sequence

from drivers.mavlink.endpoint import Endpoint
from drivers.mavlink.framing import WireFrame
from drivers.mavlink.ports import Address
from drivers.mavlink.sender_splitters import SenderSplitters


class Forwarder:
    """Endpoints that share the vehicle. ``to_vehicle(frame)`` is called from their threads.

    What they send is cut into whole frames first, so that two programs' bytes never mix within one; bytes that are
    no frame go no further and are counted in ``garbage_bytes``.
    """

    def __init__(self, connections: Sequence[str], to_vehicle: Callable[[WireFrame], bool]) -> None:
        self.garbage_bytes = 0
        self._to_vehicle = to_vehicle
        self._endpoints = [Endpoint(c, self._receiver()) for c in connections]

    def start(self) -> None:
        """Open them."""
        for endpoint in self._endpoints:
            endpoint.start()

    def write(self, data: bytes) -> None:
        """Bytes of the vehicle, or of ours, to all of them."""
        for endpoint in self._endpoints:
            endpoint.write(data)

    def close(self) -> None:
        """Close them."""
        for endpoint in self._endpoints:
            endpoint.close()

    def _receiver(self) -> Callable[[bytes, Address], None]:
        splitters = SenderSplitters()

        def receive(data: bytes, sender: Address) -> None:
            for piece in splitters.of(sender).feed(data):
                if isinstance(piece, WireFrame):
                    self._to_vehicle(piece)
                else:
                    self.garbage_bytes += len(piece.data)

        return receive
