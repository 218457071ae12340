"""What every page and figure shares: one page model for Markdown and HTML (`page`), and numbers and names in plain
words.
"""
