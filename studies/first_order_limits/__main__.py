from studies import first_order_limits

first_order_limits.STUDY.run(first_order_limits.__doc__)
