from studies import peers

peers.STUDY.run(peers.__doc__)
