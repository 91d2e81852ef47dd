"""Models as C99: a graph of the equations, a printer, and the check by replay."""
