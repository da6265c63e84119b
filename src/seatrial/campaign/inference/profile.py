"""Profile likelihoods of the full structure, kept on disk one by one: the range of each parameter that the data alone allow."""

from collections.abc import Sequence

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import not_among
from seatrial.core.reporter import SILENT, Reporter
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.profile import profile_likelihood
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.sampling.target import VECTOR

TOGETHER = VECTOR // 2  # Parameters followed at once, each to both sides: as many points as are computed at once


def stored_profiles(campaign: Campaign, trials: HasKey) -> StoredResult[Profiles]:
    """Return where the profiles of the full structure are kept, as far as they are there, and what they depend on."""
    structure = campaign.full
    path, key = Store(campaign.folder).profiles(structure.label), estimate_key(campaign, structure, trials)
    return StoredResult(path, key_of("profiles", key), Profiles, f"seatrial profile {campaign.folder}")


def profile_all(campaign: Campaign, trials: Trials, names: Sequence[str] = (), reporter: Reporter = SILENT) -> Profiles:
    """Profile parameters of the full structure; current results are read, and kept as soon as they are there.

    Args:
        campaign: configuration.
        trials: records, of which the fitted ones are used.
        names: parameters; none for all.
        reporter: receives what happens.

    Raises:
        InputError: no such parameter.
        NumericalError: a likelihood of several maxima.
    """
    structure = campaign.full
    posterior = Study(campaign, trials.fit).posterior(structure)
    known = posterior.present_names
    chosen = list(dict.fromkeys(names)) or list(known)
    for name in chosen:
        if name not in known:
            raise not_among("--parameter", name, known)
    kept = stored_profiles(campaign, trials)
    current = kept.read().profiles if kept.is_current() else ()
    by_name = {profile.name: profile for profile in current}
    missing = [name for name in chosen if name not in by_name]
    if missing:
        progress = reporter.progress(f"profile {structure.label}: {' '.join(missing)}")
        progress(0, len(missing))
        mode = find_mode(posterior, key=random_key(campaign.seed, f"mode {structure.terms}")).only(posterior.places)
        for start in range(0, len(missing), TOGETHER):
            for done, profile in enumerate(
                profile_likelihood(posterior, mode, missing[start : start + TOGETHER]), start + 1
            ):
                by_name[profile.name] = profile
                kept.write(Profiles(structure.label, structure.terms, tuple(by_name.values())))
                progress(done, len(missing))
    return Profiles(structure.label, structure.terms, tuple(by_name[name] for name in chosen))
