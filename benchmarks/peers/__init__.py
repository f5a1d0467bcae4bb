"""The same vehicle by general solvers: optional, of the dependency group ``bench``; one that is missing is reported."""
