from studies import nguyen_cross_term

nguyen_cross_term.STUDY.run(nguyen_cross_term.__doc__)
