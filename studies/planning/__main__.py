from studies import planning

planning.STUDY.run(planning.__doc__)
