"""The workbench: compare, see, learn, add, and watch the error fall, in a browser."""
