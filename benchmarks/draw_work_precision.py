"""Work-precision diagram: results/work_precision.parquet -> docs/figures/work_precision.svg."""

import pandas as pd
from matplotlib.figure import Figure

from benchmarks.project import ROOT
from benchmarks.simulate import TABLE, TARGETS

FOLDER = ROOT / "docs" / "figures"
LOOKS = {  # colours that differ for the colour-blind too, and marks
    "jointgap": ("#0072B2", "o"),
    "compiled LSODA": ("#E69F00", "s"),
    "Exudyn": ("#D55E00", "^"),
    "scipy DOP853": ("#009E73", "v"),
    "scipy LSODA": ("#CC79A7", "D"),
}


def draw(table: pd.DataFrame) -> Figure:
    """Milliseconds of a revolution over the error at 90 degrees."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    for target in TARGETS:
        axes.axvline(target, color="0.85", linewidth=1, zorder=0)
    for name, (colour, mark) in LOOKS.items():
        rows = table[(table["code"] == name) & (table["error_m"] < 1e-5)].sort_values("tolerance_m")
        if len(rows):
            axes.loglog(
                rows["error_m"],
                rows["ms_per_revolution"],
                mark,
                ls="-",
                lw=1,
                ms=4,
                color=colour,
                label=name,
            )
    axes.set_xlabel("error of positions at 90° [m]")
    axes.set_ylabel("time for one revolution [ms]")
    axes.invert_xaxis()
    axes.grid(which="major", color="0.92")
    axes.legend(loc="upper left", ncols=2, frameon=False)
    axes.set_ylim(top=6 * table["ms_per_revolution"].max())
    return figure


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure = draw(pd.read_parquet(TABLE))
    path = FOLDER / "work_precision.svg"
    figure.savefig(path)
    print(f"written to {path}")


if __name__ == "__main__":
    main()
