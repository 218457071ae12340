"""Figures: tables in, a matplotlib figure and the data it shows out.

`catalogue` lists them, `stage` draws and saves them; one module for each kind of figure in between. Importing this
package does not import matplotlib.
"""
