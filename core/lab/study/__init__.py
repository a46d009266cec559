"""A blind comparison of two methods by people: the paper's user study over the outputs of a benchmark."""
