from studies import circles

circles.STUDY.run(circles.__doc__)
