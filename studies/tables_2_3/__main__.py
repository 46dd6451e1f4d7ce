from studies import tables_2_3

tables_2_3.STUDY.run(tables_2_3.__doc__)
