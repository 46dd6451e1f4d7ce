from studies import scaling_factor

scaling_factor.STUDY.run(scaling_factor.__doc__)
