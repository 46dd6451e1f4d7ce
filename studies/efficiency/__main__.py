from studies import efficiency

efficiency.STUDY.run(efficiency.__doc__)
