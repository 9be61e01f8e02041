"""Finds composite actions in recordings of agents (MCAP), and in arrays.

`extract` takes recordings and writes Parquet tables, `read_segments` and its siblings read those, and
`extract_arrays` takes an episode that is in memory. All run the `coact` binary that comes with this package;
`coact` and `python -m coact` run it as it is.
"""

from importlib.metadata import version

from coact._arrays import Extraction, JointExtraction, Segments, Series, extract_arrays
from coact._binary import Error, binary
from coact._extract import ExtractOptions, MethodOptions, Run, extract
from coact._tables import committed_parts, read_episodes, read_recordings, read_segments, read_steps

__all__ = [
    "Error",
    "ExtractOptions",
    "Extraction",
    "JointExtraction",
    "MethodOptions",
    "Run",
    "Segments",
    "Series",
    "binary",
    "committed_parts",
    "extract",
    "extract_arrays",
    "read_episodes",
    "read_recordings",
    "read_segments",
    "read_steps",
]

__version__ = version("coact")
