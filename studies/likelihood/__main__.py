from studies import likelihood

likelihood.STUDY.run(likelihood.__doc__)
