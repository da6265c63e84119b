"""Arrays with named dimensions, as results are kept: what commands need of xarray's `Dataset`, which takes half a second to load.

Whatever is not here is asked of `to_xarray`, so that to those who evaluate results in Python these are xarray's.
"""

from collections.abc import Collection, Iterator, Mapping
from functools import wraps
from inspect import ismethod
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

if TYPE_CHECKING:
    import xarray as xr


class Variable(NamedTuple):
    """An array, the names of its dimensions, and what is said of it."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, Any]


class Dataset:
    """Variables that share dimensions; a coordinate of a dimension's own name holds the labels along it.

    Attributes:
        variables: all, coordinates included, by name.
        coordinates: names of those that are coordinates.
        attrs: what is said of the whole.
    """

    def __init__(
        self,
        data_vars: Mapping[str, Any] | None = None,
        coords: Mapping[str, Any] | None = None,
        attrs: Mapping[str, Any] | None = None,
    ):
        """Put variables together, each as (dimensions, values, attributes or nothing); a coordinate alone is of its own dimension.

        Raises:
            ValueError: a variable has other dimensions than it names, or a dimension two lengths.
        """
        given = {**(data_vars or {}), **(coords or {})}
        self.variables = {name: _variable(name, one) for name, one in given.items()}
        self.coordinates = frozenset(coords or {})
        self.attrs = dict(attrs or {})
        for name, one in self.variables.items():
            if one.values.shape != tuple(self.sizes[dim] for dim in one.dims):
                raise ValueError(
                    f"{name} has the shape {one.values.shape}, and the dimensions {one.dims} of {self.sizes}"
                )

    @classmethod
    def of(cls, dataset: "Dataset | xr.Dataset") -> "Dataset":
        """Take over one of xarray."""
        if isinstance(dataset, cls):
            return dataset
        parts = {str(name): (one.dims, one.values, one.attrs) for name, one in dataset.variables.items()}
        return cls(*_parted(parts, set(map(str, dataset.coords))), {**dataset.attrs})

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions."""
        lengths = [pair for one in self.variables.values() for pair in zip(one.dims, one.values.shape, strict=False)]
        return dict(lengths)

    @property
    def data_vars(self) -> dict[str, "DataColumn"]:
        """What is no coordinate, by name."""
        return {name: self[name] for name in self.variables if name not in self.coordinates}

    @overload
    def __getitem__(self, name: str) -> "DataColumn": ...
    @overload
    def __getitem__(self, name: list[str]) -> "xr.Dataset": ...
    def __getitem__(self, name: str | list[str]) -> "DataColumn | xr.Dataset":
        return DataColumn(self, name, self.variables[name]) if isinstance(name, str) else self.to_xarray()[name]

    def __contains__(self, name: object) -> bool:
        return name in self.variables

    def __iter__(self) -> Iterator[str]:
        return iter(self.data_vars)

    def __len__(self) -> int:
        return len(self.data_vars)

    def __repr__(self) -> str:
        return repr(self.to_xarray())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return _asked(self.to_xarray(), name)

    def assign_attrs(self, **attrs: Any) -> "Dataset":
        """Return one with more said of the whole."""
        return self._with(self.variables, {**self.attrs, **attrs})

    def isel(self, **places: Any) -> "Dataset":
        """Return what is at some places along dimensions: a number drops the dimension, a slice or an array keeps it."""

        def part(one: Variable) -> Variable:
            values, dims = one.values, one.dims
            for dim, place in places.items():
                if dim in dims:
                    values = values[(slice(None),) * dims.index(dim) + (place,)]
                    dims = dims if np.ndim(place) or isinstance(place, slice) else tuple(x for x in dims if x != dim)
            return Variable(dims, values, one.attrs)

        return self._with({name: part(one) for name, one in self.variables.items()}, self.attrs)

    def sel(self, **labels: Any) -> "Dataset":
        """Return what has some labels along dimensions.

        Raises:
            KeyError: no such label.
        """
        return self.isel(**{dim: _places(dim, self.variables[dim].values, label) for dim, label in labels.items()})

    def only(self, name: str) -> "Dataset":
        """Return one variable and the coordinates."""
        return self._with(
            {key: one for key, one in self.variables.items() if key == name or key in self.coordinates}, {}
        )

    def to_xarray(self) -> "xr.Dataset":
        """Return the same as xarray's."""
        import xarray

        return xarray.Dataset(*_parted(self.variables, self.coordinates), self.attrs)

    def _with(self, variables: Mapping[str, Variable], attrs: Mapping[str, Any]) -> "Dataset":
        return Dataset(*_parted(variables, self.coordinates), attrs)


class DataColumn(NDArrayOperatorsMixin):
    """A variable of a dataset, which knows the labels along its dimensions; calculations with it are xarray's."""

    def __init__(self, dataset: Dataset, name: str, variable: Variable):
        self._dataset, self._name = dataset, name
        self.dims, self.values, self.attrs = variable

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of its dimensions."""
        return dict(zip(self.dims, self.values.shape, strict=True))

    def sel(self, **labels: Any) -> "DataColumn":
        """Return what has some labels along dimensions."""
        return self._dataset.only(self._name).sel(**labels)[self._name]

    def item(self) -> Any:
        """Return its one value as Python has it."""
        return self.values.item()

    def to_xarray(self) -> "xr.DataArray":
        """Return the same as xarray's."""
        return self._dataset.to_xarray()[self._name]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype, copy=copy)

    def __repr__(self) -> str:
        return repr(self.to_xarray())

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return getattr(ufunc, method)(*map(_as_xarray, inputs), **options)

    def __float__(self) -> float:
        return float(self.values)

    def __int__(self) -> int:
        return int(self.values)

    def __bool__(self) -> bool:
        return bool(self.values)

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, place: Any) -> Any:
        return self.values[place]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return _asked(self.to_xarray(), name)


def _parted(variables: Mapping[str, Any], coordinates: Collection[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variables that are no coordinates, and those that are."""
    data = {name: one for name, one in variables.items() if name not in coordinates}
    return data, {name: one for name, one in variables.items() if name in coordinates}


def _asked(of: Any, name: str) -> Any:
    """Return what an object of xarray has by a name; its methods take our datasets and columns where they take xarray's."""
    attribute = getattr(of, name)
    if not ismethod(attribute):
        return attribute

    @wraps(attribute)
    def method(*arguments: Any, **options: Any) -> Any:
        return attribute(*map(_as_xarray, arguments), **{key: _as_xarray(one) for key, one in options.items()})

    return method


def _as_xarray(one: Any) -> Any:
    return one.to_xarray() if isinstance(one, Dataset | DataColumn) else one


def _variable(name: str, given: Any) -> Variable:
    dims, values, *attrs = given if isinstance(given, tuple) else ((name,) if np.ndim(given) else (), given)
    array = np.asarray(values)
    return Variable((dims,) if isinstance(dims, str) else tuple(dims), array, dict(attrs[0]) if attrs else {})


def _places(dim: str, labels: np.ndarray, label: Any) -> Any:
    """Return the place of a label, or the places of several."""
    places = {one: place for place, one in enumerate(labels.tolist())}
    try:
        return (
            [places[one] for one in np.asarray(label).tolist()] if np.ndim(label) else places[np.asarray(label).item()]
        )
    except KeyError as missing:
        raise KeyError(f"no {missing.args[0]} along {dim}, which has {', '.join(map(str, places))}") from None
