"""SymPy derivations of every closed form the toolkit uses, and the generator of their NumPy text.

Nothing here is needed at run time: `uq_handeye.methods._closed_form` is what this package prints.
One way through it: `octonion`, `procrustes`, `so4`, `limit` and `derivatives` derive; `matrices` lists what
exists; `elimination` shares common subexpressions; `cache` keeps results on disk; `printing` turns them into
source text; `generate` writes or checks the checked-in files; `functions` compiles all others on first use.
For people: `language`, `languages` and `latex` spell a matrix in other languages, `whole_functions` fills the templates
of solve_4dpa and covariance_4dpa, `codegen` puts them into files.
"""
