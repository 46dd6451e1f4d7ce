from studies import posterior_moves

posterior_moves.STUDY.run(posterior_moves.__doc__)
