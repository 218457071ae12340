"""Write the data of an example from its download: ``python -m examples.convert NAME DOWNLOAD``."""

import importlib
import sys
from pathlib import Path

from jointgap.core.errors import InputError
from jointgap.core.files import write_text

EXAMPLES = Path(__file__).parent


def write(name: str, download: Path, folder: Path | None = None) -> list[Path]:
    """Write the CSV files that ``model.yaml`` of the example `name` lists.

    Parameters
    ----------
    name : str
        Folder in ``examples``, such as ``pendulum``.
    download : Path
        Folder with the files of the authors.
    folder : Path, optional
        Folder for ``data/*.csv``; that of the example by default.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        There is no such example, or a file is missing or has other columns.
    """
    names = sorted(path.parent.name for path in EXAMPLES.glob("*/convert.py"))
    if name not in names:
        raise InputError(f"there is no example '{name}'; the examples are {', '.join(names)}")
    example = importlib.import_module(f"examples.{name}.convert")
    target = (folder or EXAMPLES / name) / "data"
    try:
        tables = example.tables(download)
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise InputError(
            f"'{download}' is not the download of the example {name}: {error}; get it from"
            f" {example.ADDRESS}"
        ) from error
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for run, table in tables.items():
        written.append(target / f"{run}.csv")
        write_text(written[-1], table.to_csv(index=False, float_format="%.7g"))
    return written


def main() -> None:
    """Write the files and print their paths."""
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        for path in write(sys.argv[1], Path(sys.argv[2])):
            print(path)
    except InputError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
