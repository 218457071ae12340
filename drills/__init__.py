"""What damaged, hostile and interrupted use does to the project: `make drill`. A module with a `DRILL` is a drill."""
