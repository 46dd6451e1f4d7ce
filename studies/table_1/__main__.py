from studies import table_1

table_1.STUDY.run(table_1.__doc__)
