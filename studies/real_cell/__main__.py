from studies import real_cell

real_cell.STUDY.run(real_cell.__doc__)
