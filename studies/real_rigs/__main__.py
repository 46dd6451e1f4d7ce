from studies import real_rigs

real_rigs.STUDY.run(real_rigs.__doc__)
