"""A benchmark for other methods: campaigns as plain files, answers as JSON, and their score
(README.md)."""
