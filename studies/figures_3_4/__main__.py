from studies import figures_3_4

figures_3_4.STUDY.run(figures_3_4.__doc__)
