"""What can be measured of a design; columns of the table `sweep_designs`."""

from jointgap.core.schema import BEST_LENGTHS, MEASURES, PRINTED_OPTIMA, Column

ALL_MEASURES = (*MEASURES.columns, *BEST_LENGTHS.columns, *PRINTED_OPTIMA.columns)


def measured(best_lengths: bool, printed_numbers: bool) -> tuple[Column, ...]:
    """What is measured of each design of a sweep."""
    return (
        *MEASURES.columns,
        *(BEST_LENGTHS.columns if best_lengths or printed_numbers else ()),
        *(PRINTED_OPTIMA.columns if printed_numbers else ()),
    )
