from studies import headline

headline.STUDY.run(headline.__doc__)
