"""What all pieces of a campaign's work share: its configuration and its records, and what has been built of them in this process."""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any, TypeVar

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.posterior import build_posterior, narrow_posterior, widest
from seatrial.core.processes import cores
from seatrial.core.record import Record
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.selection.structures import Structure

Built = TypeVar("Built")
MIN_KEPT = 8  # Things that are kept built at least


class Study:
    """A campaign and the records that are fitted. Only these travel; posteriors are built where they are needed, once in a process.

    Attributes:
        campaign: configuration.
        records: fitted trials.
        extra: whatever else the pieces share; plain data.
    """

    def __init__(self, campaign: Campaign, records: Sequence[Record] = (), extra: Any = None):
        self.campaign, self.records, self.extra = campaign, tuple(records), extra
        self._built: OrderedDict[Hashable, Any] = OrderedDict()
        self._locks: dict[Hashable, Lock] = {}
        self._lock = Lock()

    def __reduce__(self):
        """As data, without what has been built."""
        return Study, (replace(self.campaign), self.records, self.extra)

    def posterior(self, structure: Structure) -> Posterior:
        """Posterior of a structure given the records, by programs that all structures share; errors as `build_posterior`."""
        campaign, records = self.campaign, self.records

        def narrow() -> Posterior:
            wide = self.once("posterior", lambda: build_posterior(campaign, widest(campaign.structures), records))
            return narrow_posterior(campaign, wide, structure, records)

        return self.once(("posterior", structure.terms), narrow)

    def once(self, name: Hashable, build: Callable[[], Built]) -> Built:
        """What goes by this name; built where it is not there, by one thread while others wait for it."""
        with self._lock:
            lock = self._locks.setdefault(name, Lock())
        with lock:
            with self._lock:
                if name in self._built:
                    self._built.move_to_end(name)
                    return self._built[name]
            made = build()
            with self._lock:
                self._built[name] = made
                while len(self._built) > max(MIN_KEPT, 2 * cores()):
                    self._built.popitem(last=False)
            return made
