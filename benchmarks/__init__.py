"""What the project promises, measured: `make bench`. Every module here has `measure() ->
list[dict]`."""
